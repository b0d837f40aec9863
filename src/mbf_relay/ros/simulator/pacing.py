"""Simulated time against the wall clock."""

from __future__ import annotations

import threading
import time
from typing import Callable, Optional

CATCH_UP = 0.25
"""Largest delay (wall s) that is made up for; after a longer pause of the machine, the simulation must not rush."""


class RealTimePacer:
    """Keeps simulated time at `factor` times the wall clock, never on ROS time, which is what it makes.

    Args:
        factor: Simulated seconds per wall second; 0 for no limit.
        clock: The wall clock, for tests.
        wait: Waits for some wall seconds, for tests.
    """

    def __init__(
        self,
        factor: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Optional[Callable[[float], object]] = None,
    ) -> None:
        self.factor = factor
        self._clock = clock
        self._wait = wait or threading.Event().wait
        self._due = clock()

    def restart(self) -> None:
        """Begin anew after a pause, with nothing to make up for."""
        self._due = self._clock()

    def pace(self, simulated: float) -> bool:
        """Wait until the wall clock has come as far as `simulated` seconds ask for; return True, as it has."""
        if self.factor <= 0.0:
            return True
        self._due += simulated / self.factor
        ahead = self._due - self._clock()
        if ahead > 0.0:
            self._wait(ahead)
        elif ahead < -CATCH_UP:
            self._due = self._clock() - CATCH_UP
        return True


class FactorMeter:
    """Measures the achieved real time factor between one look and the next."""

    def __init__(self, simulated: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._wall, self._simulated = clock(), simulated
        self.factor: Optional[float] = None

    def measure(self, simulated: float) -> Optional[float]:
        """Return simulated seconds per wall second since the last look, None where no time went by."""
        wall = self._clock()
        if wall - self._wall > 0.05:
            self.factor = (simulated - self._simulated) / (wall - self._wall)
            self._wall, self._simulated = wall, simulated
        return self.factor
