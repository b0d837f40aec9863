"""How old a sensor's newest data usually get before newer ones come, and so when it has fallen silent."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Tuple

REMEMBERED = 9
"""Renewals that say what is usual."""
FEWEST = 3
"""Renewals before which nothing is usual yet."""
SHORTEST = 0.4
"""Seconds that every sensor may be silent: to stand within half a second, at 10 Hz of control, needs no less."""


class UsualAge:
    """Measures a sensor's period, and the age its data reach by period, sweep and latency before newer ones come.

    A fixed limit would let a lidar of 40 Hz be blind as long as one of 5 Hz, and find a busy machine's scans too old.
    """

    def __init__(self) -> None:
        self._renewals: Deque[Tuple[float, float]] = deque(maxlen=REMEMBERED)
        self._limit = math.inf

    def renewed(self, age: float, period: float) -> None:
        """Take note that data came that were measured `period` (s) after the last, which were `age` (s) old then.

        Below 0 time was set back.
        """
        if age < 0.0 or period < 0.0:
            self._renewals.clear()
        else:
            self._renewals.append((age, period))
        self._limit = math.inf
        if len(self._renewals) >= FEWEST:
            ages, periods = zip(*self._renewals)
            ordered = sorted(periods)
            usual = 0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2])  # their median
            self._limit = max(SHORTEST, float(max(ages) + usual))

    def limit(self, longest: float) -> float:
        """Return the age (s) from which the sensor is silent: one message may get lost, or be as late as lately.

        It is `longest` (s) at most, and while nothing is usual yet.
        """
        return min(longest, self._limit)
