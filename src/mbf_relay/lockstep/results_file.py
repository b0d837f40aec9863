"""Results on disk: a folder with one line per finished episode, which survives being killed at any moment."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Set, Tuple

from mbf_relay.lockstep.command import have_alone
from mbf_relay.lockstep.result import ERROR, EpisodeResult
from mbf_relay.whole_files import write_whole

LINES = "episodes.jsonl"
SETTINGS = "settings.json"

CODE = ("version", "sources", "plugins")
"""Settings that tell what code has driven."""

WORLDS = "world_digests"
"""Setting that holds a hash of each world by its name: names alone do not tell an edited world from the one before."""

Key = Tuple[str, int]
"""World and seed: what tells the episodes of one batch apart."""


class ResultsFile:
    """The results of one batch, open for appending by one process at a time.

    Attributes:
        warnings: One per line that could not be read.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        """Open or make the folder.

        Args:
            folder: Where to keep the results.
            settings: What was driven with which parameters; a folder holds the results of one such thing.

        Raises:
            ValueError: The folder holds results of other settings, or another batch is writing there.
        """
        self._folder, self._is_new = folder, not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / LINES
        self._descriptor = os.open(str(self._path), os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            have_alone(self._descriptor, folder, "batch")
            _check_settings(folder, settings)
            self._end_last_line()
            found, self.warnings = read_lines(self._path)
            self._results = {(result.world, result.seed): result for result in found}
        except BaseException:
            os.close(self._descriptor)
            raise

    def _end_last_line(self) -> None:
        """End a line that a kill cut short, so that the next one starts on its own."""
        size = os.fstat(self._descriptor).st_size
        if size and os.pread(self._descriptor, 1, size - 1) != b"\n":
            os.write(self._descriptor, b"\n")

    @property
    def results(self) -> List[EpisodeResult]:
        """What was found and appended, the newest of each episode."""
        return list(self._results.values())

    @property
    def done(self) -> Set[Key]:
        """World and seed of every episode that has a result."""
        return set(self._results)

    @property
    def failed(self) -> Set[Key]:
        """World and seed of every episode that crashed, hung or could not be driven."""
        return {key for key, result in self._results.items() if result.outcome == ERROR}

    def append(self, result: EpisodeResult) -> None:
        """Write a result; when this returns, it survives a crash of the machine; OSError where the disk is full."""
        # First: an interrupt during the writing must not leave it out of the summary.
        self._results[result.world, result.seed] = result
        left = (result.to_line() + "\n").encode()
        try:
            while left:  # on a disk that fills, less is written than was asked for, and only the next try fails
                left = left[os.write(self._descriptor, left):]
            os.fsync(self._descriptor)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error

    def close(self) -> None:
        """Release the folder; where nothing was driven, leave nothing there that a batch of other settings minds."""
        try:
            if not self._results and os.fstat(self._descriptor).st_size == 0:
                for name in (SETTINGS, LINES):
                    (self._folder / name).unlink()
                if self._is_new:
                    self._folder.rmdir()
        finally:
            os.close(self._descriptor)


def read_lines(path: Path) -> Tuple[List[EpisodeResult], List[str]]:
    """Return the results in a file, the newest where an episode stands twice, and a warning of broken lines.

    Raises:
        ValueError: There is no such file.
    """
    if not path.is_file():
        raise ValueError(f"there are no results: {path} does not exist")
    results: Dict[Key, EpisodeResult] = {}
    broken: List[str] = []
    with open(path, encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            try:
                result = EpisodeResult.from_line(line)
                results[result.world, result.seed] = result
            except ValueError as error:
                broken.append(f"{path}, line {number}, is left out: {error}")
    if len(broken) > 1:
        broken[:] = [f"{broken[0]}; so are {len(broken) - 1} more"]
    return list(results.values()), broken


def _check_settings(folder: Path, settings: Mapping[str, Any]) -> None:
    path = folder / SETTINGS
    text = json.dumps(settings, indent=1, sort_keys=True) + "\n"
    if not path.exists():
        write_whole(path, text)
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} cannot be read ({error}); choose another --out") from error
    now = json.loads(text)
    changed = sorted(name for name in set(before) | set(now) if before.get(name) != now.get(name))
    code = sorted(set(changed) & set(CODE))
    if code:
        name = code[0]
        raise ValueError(
            f"{folder} holds results of other code ({name} was {_short(before.get(name))}, now "
            f"{_short(now.get(name))}); choose another --out, or go back to that code"
        )
    others = other_worlds(before, now)
    if others:
        raise ValueError(f"{folder} holds results of other settings (world '{others[0]}' is another one now); "
                         "choose another --out")
    if changed:
        name = changed[0]
        raise ValueError(
            f"{folder} holds results of other settings ({name} was {_short(before.get(name))}, "
            f"now {_short(now.get(name))}); choose another --out"
        )


def other_worlds(one: Any, other: Any) -> List[str]:
    """Return the names by which two settings mean different worlds; none where either does not say."""
    a, b = (settings.get(WORLDS) if isinstance(settings, Mapping) else None for settings in (one, other))
    if not isinstance(a, Mapping) or not isinstance(b, Mapping):
        return []
    return sorted(name for name in set(a) & set(b) if a[name] != b[name])


def read_settings(path: Path) -> Optional[Dict[str, Any]]:
    """Return the settings of a folder of results, or of the file in it; None where they are not known."""
    folder = path if path.is_dir() else path.parent
    try:
        found = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
