"""Measuring time on a clock that may stand still or jump back, as a simulation's does."""

from __future__ import annotations

import math
from typing import Optional

ROUNDING = 1e-6
"""Seconds by which a time may miss a multiple of a period for want of digits."""
SET_BACK = 1.0
"""Seconds by which something is ahead of now that is of before the clock was set back; less are a thread's that looked
at the clock, and then waited."""


class Stopwatch:
    """Time since something; starts anew when the clock jumps back."""

    def __init__(self, since: Optional[float] = None) -> None:
        self._since = since

    @property
    def running(self) -> bool:
        """Return whether it was started."""
        return self._since is not None

    def start(self, now: float) -> None:
        """Start anew at `now` (s)."""
        self._since = now

    def reset(self) -> None:
        """Stop; `elapsed` is 0 until the next start."""
        self._since = None

    def leave_out(self, seconds: float) -> None:
        """Count some of the time since the start no longer."""
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
    """Says when the next cycle is due: at a fixed rate, without catching up on cycles that were missed."""

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
