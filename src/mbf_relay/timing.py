"""Stopwatch and fixed rate on a clock that may stand still or jump back, such as a simulation's."""

from __future__ import annotations

import math
from typing import Optional

ROUNDING = 1e-6
"""Tolerance (s) for rounding errors of times."""
SET_BACK = 1.0
"""Time (s) by which a stamp must be ahead of now to be from before the clock was set back; smaller differences come
from threads that read the clock and were then delayed."""

UNSEEN = 1.0
"""Time (s) by which an update must be late for waiting times to start over: the process was suspended, or the clock
set forward."""


class Stopwatch:
    """Time since a start; starts again when the clock jumps back."""

    def __init__(self, since: Optional[float] = None) -> None:
        self._since = since

    @property
    def running(self) -> bool:
        """Whether it was started."""
        return self._since is not None

    def start(self, now: float) -> None:
        """Start anew at `now` (s)."""
        self._since = now

    def reset(self) -> None:
        """Stop; `elapsed` is 0 until the next start."""
        self._since = None

    def leave_out(self, seconds: float) -> None:
        """Subtract some time (s) from the elapsed time."""
        if self._since is not None:
            self._since += seconds

    def elapsed(self, now: float) -> float:
        """Return the seconds since the start."""
        if self._since is None:
            return 0.0
        if now < self._since - ROUNDING:
            self._since = now
        return now - self._since


class Pacer:
    """Times of cycles at a fixed rate, without catching up on missed ones."""

    def __init__(self) -> None:
        self._last = -math.inf
        self._next = -math.inf

    @property
    def next(self) -> float:
        """Time (s) of the next cycle."""
        return self._next

    def is_due(self, now: float) -> bool:
        """Return whether a cycle is due, also when the clock jumped back."""
        return now >= self._next - ROUNDING or now < self._last - ROUNDING

    def passed(self, now: float, period: float) -> None:
        """Note a cycle at `now`; the next one is due `period` seconds after this one was."""
        on_time = self._next if self._last <= now < self._next + period else now
        self._last, self._next = now, max(on_time, now - period) + period

    def postpone(self, now: float, delay: float) -> None:
        """Make the next cycle due `delay` seconds from `now`."""
        self._last, self._next = now, now + delay

    def hasten(self) -> None:
        """Make a cycle due at once."""
        self._next = -math.inf
