"""Helpers of the lockstep commands: arguments, a lock on folders, a progress bar, numbers for JSON."""

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
    """Return numbers for JSON, with None (null) for those that are not finite."""
    return [value if math.isfinite(value) else None for value in values]


def have_alone(descriptor: int, folder: Path, whose: str) -> None:
    """Lock an open file or folder for this process (flock) until it is closed; ignored where locks are unsupported.

    Args:
        descriptor: Of the open file or folder.
        folder: For the error.
        whose: What kind of program uses it, for the error.

    Raises:
        ValueError: Another process holds the lock.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ValueError(f"another {whose} is writing to {folder}; wait for it or choose another --out") from error
    except OSError:
        pass


def say(text: str) -> None:
    """Print a text; where the pipe is closed (`| head`), print nothing from then on and go on."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        gone = os.open(os.devnull, os.O_WRONLY)
        os.dup2(gone, sys.stdout.fileno())  # else Python fails once more when it flushes stdout at exit
        os.close(gone)


class Progress:
    """A progress bar on a terminal; elsewhere a line for every tenth of the work.

    Args:
        total: Number of pieces of work.
        stream: Where to write; stderr where None.
    """

    def __init__(self, total: int, stream: Optional[TextIO] = None) -> None:
        self._total = total
        self._stream = stream or sys.stderr
        self._is_terminal = self._stream.isatty()
        self._tenths = -1

    def show(self, done: int, elapsed: float, note: str) -> None:
        """Show that `done` pieces were done in `elapsed` seconds; `note` is shown at the end of the line."""
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
        """End the bar's line on a terminal."""
        if self._is_terminal:
            self._stream.write("\n")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes}:{rest:02d} min"
