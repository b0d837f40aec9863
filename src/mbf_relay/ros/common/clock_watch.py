"""Detects on the wall clock that ROS time stands still: a timeout in ROS time would never end then."""

from __future__ import annotations

import math
import time

CLOCK_STANDS = 0.5
"""Wall seconds without a change of ROS time after which it counts as standing, and the robot must be stopped."""
TICKS_LATE = 3.0
"""Factor on the shorter of the last two intervals between changes of ROS time; the limit where it exceeds CLOCK_STANDS.
A simulation far slower than real time ticks seldom. The shorter of two, so that one pause does not count."""


class ClockWatch:
    """Told ROS time by `note`, says whether it stands still.

    The simulation may be paused, the publisher of /clock may hang, or nobody has ever published it.
    """

    def __init__(self) -> None:
        self._time = 0.0  # ROS time before the first /clock
        self._ran_at, self._tick_period, self._took = time.monotonic(), 0.0, math.inf

    def note(self, now: float) -> None:
        """Take note of the time (s) that ROS shows."""
        if now != self._time:
            wall = time.monotonic()
            if self._time:
                before, self._took = self._took, wall - self._ran_at
                self._tick_period = min(before, self._took)
            self._time, self._ran_at = now, wall

    @property
    def stands(self) -> bool:
        """Whether there is no ROS time yet, or it has not changed for much longer than its usual interval."""
        return self._time == 0.0 or time.monotonic() - self._ran_at > max(CLOCK_STANDS, TICKS_LATE * self._tick_period)
