"""Does ROS time go on? Asked on the wall clock: what counts in a time that stands waits for ever."""

from __future__ import annotations

import math
import time

CLOCK_STANDS = 0.5
"""Wall seconds without simulated time after which the wheels must not go on by what was sent before."""
TICKS_LATE = 3.0
"""Times as long as the last two ticks took to come, the quicker of them, as far as that is more: simulations far below
real time tick slowly, and one tick after a pause is none that does."""


class ClockWatch:
    """Is shown ROS time, and tells whether it stands.

    It may be paused, whoever publishes /clock may hang, or nobody has ever published it; a wheel on the wall clock
    knows nothing of either.
    """

    def __init__(self) -> None:
        self._time = 0.0  # what ROS shows before there is any
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
        """Whether there is no time yet, or it is one and the same for much longer than it took from tick to tick."""
        return self._time == 0.0 or time.monotonic() - self._ran_at > max(CLOCK_STANDS, TICKS_LATE * self._tick_period)
