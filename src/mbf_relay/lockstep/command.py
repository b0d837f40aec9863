"""What the lockstep commands share: arguments, a progress bar, numbers for JSON."""

from __future__ import annotations

import fcntl
import math
import os
import sys
from pathlib import Path
from typing import List, Optional, Sequence, TextIO


def without_remappings(arguments: Sequence[str]) -> List[str]:
    """Return the arguments without the name:=value pairs that roslaunch adds."""
    return [argument for argument in arguments if ":=" not in argument]


def or_null(values: Sequence[float]) -> List[Optional[float]]:
    """Return numbers for JSON: those that are not finite are None, which it writes as null."""
    return [value if math.isfinite(value) else None for value in values]


def have_alone(descriptor: int, folder: Path, whose: str) -> None:
    """Lock an open file or folder against others until it is closed; a file system without locks has none.

    Raises:
        ValueError: Another process has it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ValueError(f"another {whose} is writing to {folder}; wait for it or choose another --out") from error
    except OSError:
        pass


def say(text: str) -> None:
    """Print a text; where its reader has gone (`| head`), nothing is printed any more, and the work goes on."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        gone = os.open(os.devnull, os.O_WRONLY)
        os.dup2(gone, sys.stdout.fileno())  # else Python would fail over what is left once more, at its end
        os.close(gone)


class Progress:
    """A bar on a terminal; elsewhere a line for every tenth of the way."""

    def __init__(self, total: int, stream: Optional[TextIO] = None) -> None:
        self._total = total
        self._stream = stream or sys.stderr
        self._is_terminal = self._stream.isatty()
        self._tenths = -1

    def show(self, done: int, elapsed: float, note: str) -> None:
        """Show that `done` of all were done in `elapsed` seconds; `note` says how they went."""
        share = done / self._total if self._total else 1.0
        left = elapsed * (1.0 - share) / share if share > 0.0 else math.nan
        rest = f", {_duration(left)} left" if math.isfinite(left) and done < self._total else ""
        rate = 60.0 * done / elapsed if elapsed > 0.0 else math.inf
        pace = f", {rate:.{0 if rate >= 10.0 else 1}f} a minute" if math.isfinite(rate) else ""
        text = f"{done}/{self._total} in {_duration(elapsed)}{pace}{rest}: {note}"
        if self._is_terminal:
            bar = "#" * int(24 * share)
            self._stream.write(f"\r\x1b[K[{bar:<24}] {text}")
            self._stream.flush()
        elif int(10 * share) > self._tenths:
            self._tenths = int(10 * share)
            self._stream.write(text + "\n")
            self._stream.flush()

    def end(self) -> None:
        """Leave the bar's line."""
        if self._is_terminal:
            self._stream.write("\n")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes}:{rest:02d} min"
