"""Does ROS time go on? Asked on the wall clock: what counts in a time that stands waits for ever."""

from __future__ import annotations

import time

CLOCK_STANDS = 0.5
"""Wall seconds without simulated time after which the wheels must not go on by what was sent before."""
TICKS_LATE = 3.0
"""Times as long as the last tick took to come, as far as that is more: simulations far below real time tick slowly."""


class ClockWatch:
    """Is shown ROS time, and tells whether it stands.

    It may be paused, whoever publishes /clock may hang, or nobody has ever published it; a wheel on the wall clock
    knows nothing of either.
    """

    def __init__(self) -> None:
        self._time = 0.0  # what ROS shows before there is any
        self._ran_at, self._tick_period = time.monotonic(), 0.0

    def note(self, now: float) -> None:
        """Take note of the time (s) that ROS shows."""
        if now != self._time:
            wall = time.monotonic()
            self._tick_period = wall - self._ran_at if self._time else 0.0
            self._time, self._ran_at = now, wall

    @property
    def stands(self) -> bool:
        """Whether there is no time yet, or it is one and the same for much longer than it took from tick to tick."""
        return self._time == 0.0 or time.monotonic() - self._ran_at > max(CLOCK_STANDS, TICKS_LATE * self._tick_period)
