"""The age that a sensor's newest data usually reach before new data come, and so when it has fallen silent."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Tuple

REMEMBERED = 9
"""Latest arrivals of data that are evaluated."""
FEWEST = 3
"""Arrivals needed for an estimate."""
SHORTEST = 0.4
"""Seconds that any sensor may be silent; at 10 Hz of control the robot then stops within half a second."""


class UsualAge:
    """Limit on the age of a sensor's data, from its period and from the ages its data reached lately.

    A fixed limit would allow a lidar of 40 Hz to be silent as long as one of 5 Hz, and refuse scans on a busy computer.
    """

    def __init__(self) -> None:
        self._renewals: Deque[Tuple[float, float]] = deque(maxlen=REMEMBERED)
        self._limit = math.inf

    def renewed(self, age: float, period: float) -> None:
        """Record the arrival of new data; a negative value means that time was set back, and starts anew.

        Args:
            age: Age (s) that the data before had reached by now.
            period: Time (s) from their measurement to that of the new data.
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
        """Return the age (s) above which the sensor counts as silent: the largest of late plus one usual period.

        So one message may be lost. It is at least SHORTEST and at most `longest` (s), which holds until there are
        enough arrivals.
        """
        return min(longest, self._limit)
