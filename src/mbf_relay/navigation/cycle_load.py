"""Computing time and rate of control cycles, and the speed they allow."""

from __future__ import annotations

import collections
import math
from typing import Deque

SPARE = 0.7
"""Share of the control period that a controller may compute for; the rest is left to sensors, planning and clients."""
WEIGHT = 0.2
"""Weight of the newest cycle in the exponential moving average: a single slow cycle changes little."""
MOST = 10.0
"""Largest number of periods that one cycle counts for."""


class CycleLoad:
    """Moving average of computing time divided by the control period.

    A velocity is computed from the sensor data at the beginning of its cycle; until it is sent, the robot drives by the
    one before. Beyond SPARE speed is reduced in proportion, so that the distance driven on old data does not grow.

    Attributes:
        share: The average; 1.0 is a whole period.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self._is_too_much = False

    def note(self, thinking: float, period: float) -> bool:
        """Take a cycle's computing time (s) and period (s); return whether the load has just become too high."""
        self.share += WEIGHT * (min(thinking / period, MOST) - self.share)
        was_too_much = self._is_too_much
        self._is_too_much = self.share > (0.5 * SPARE if was_too_much else SPARE)
        return self._is_too_much and not was_too_much

    @property
    def speed_factor(self) -> float:
        """Factor (0 to 1) on the controller's velocity."""
        return min(1.0, SPARE / self.share) if self.share > 0.0 else 1.0


class CyclePeriod:
    """The actual time between control cycles, as a multiple of the control period.

    It is longer than the period where the clock ticks more slowly: Stage's simulated time advances at 10 Hz, while most
    files ask for 20 Hz. With the nominal period, a controller would accelerate and brake half as hard as it may.
    """

    def __init__(self) -> None:
        self._last = -math.inf
        self._passed: Deque[float] = collections.deque([1.0], maxlen=3)

    def note(self, now: float, period: float) -> float:
        """Take a cycle's time (s) and the nominal period (s); return the actual one (s), a multiple of it."""
        passed, self._last = (now - self._last) / period, now
        if 0.0 < passed < MOST:  # otherwise a drive has just begun, or the clock was set
            self._passed.append(passed)
        middle = sorted(self._passed)[(len(self._passed) - 1) // 2]
        return max(1, round(middle)) * period
