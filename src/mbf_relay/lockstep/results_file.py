"""Results of a batch on disk: one line of JSON per finished episode, valid also where the process was killed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Set, Tuple

from mbf_relay.lockstep.command import have_alone
from mbf_relay.lockstep.result import ERROR, EpisodeResult
from mbf_relay.whole_files import write_whole

LINES = "episodes.jsonl"
"""File with the results, appended line by line."""
SETTINGS = "settings.json"
"""File with what the results of a folder have in common; see `batch.settings_of`."""

CODE = ("version", "sources", "plugins")
"""Settings that identify the code."""

WORLDS = "world_digests"
"""Setting with a hash of each world by its name, by which an edited world of the same name is noticed."""

Key = Tuple[str, int]
"""World and seed, which identify an episode of a batch."""


class ResultsFile:
    """The results of one batch, open for appending by one process at a time.

    Attributes:
        warnings: One per line that could not be read.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        """Open the folder, or make it.

        Args:
            folder: Folder of the results.
            settings: What all results of a folder must have in common; see `batch.settings_of`.

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
        """Append a line feed where the last line is incomplete, so that the next result starts on a new line."""
        size = os.fstat(self._descriptor).st_size
        if size and os.pread(self._descriptor, 1, size - 1) != b"\n":
            os.write(self._descriptor, b"\n")

    @property
    def results(self) -> List[EpisodeResult]:
        """All results, those read and those appended; of one episode only the newest."""
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
        """Write a result and flush it to disk (fsync); raise OSError where that fails, as on a full disk."""
        # First, so that the summary has it also where an interrupt comes during the writing.
        self._results[result.world, result.seed] = result
        left = (result.to_line() + "\n").encode()
        try:
            while left:  # a disk that is nearly full takes a part; the next write then fails
                left = left[os.write(self._descriptor, left):]
            os.fsync(self._descriptor)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error

    def close(self) -> None:
        """Close the file and release its lock; where there is no result, remove the files, and the folder if it is new.
        """
        try:
            if not self._results and os.fstat(self._descriptor).st_size == 0:
                for name in (SETTINGS, LINES):
                    (self._folder / name).unlink()
                if self._is_new:
                    self._folder.rmdir()
        finally:
            os.close(self._descriptor)


def read_lines(path: Path) -> Tuple[List[EpisodeResult], List[str]]:
    """Return the results in a file, the last where an episode occurs twice, and a warning of lines that are invalid.

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
    """Return the names of worlds whose hashes differ between two settings; empty where either lacks hashes."""
    a, b = (settings.get(WORLDS) if isinstance(settings, Mapping) else None for settings in (one, other))
    if not isinstance(a, Mapping) or not isinstance(b, Mapping):
        return []
    return sorted(name for name in set(a) & set(b) if a[name] != b[name])


def read_settings(path: Path) -> Optional[Dict[str, Any]]:
    """Return the settings of a folder of results, or of a results file; None where they cannot be read."""
    folder = path if path.is_dir() else path.parent
    try:
        found = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
