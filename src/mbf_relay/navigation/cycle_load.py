"""How long control cycles take and how often they come, and how fast a robot may drive for it."""

from __future__ import annotations

import collections
import math
from typing import Deque

SPARE = 0.7
"""Share of the control period a controller may think for without being too slow; sensors, plans and clients have the
rest."""
WEIGHT = 0.2
"""Of the newest cycle in the mean: one hiccup of the machine slows nobody."""
MOST = 10.0
"""Periods a cycle counts for at most."""


class CycleLoad:
    """The mean share of the control period that controllers think for.

    A velocity answers what was seen when its cycle began; until it is out, the robot drives on by the one before. So
    that it does not drive farther unseeing than it would with a controller that is just quick enough, it drives slower
    by as much as the controller is slower.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self._is_too_much = False

    def note(self, thinking: float, period: float) -> bool:
        """Take another cycle's time (s) and its period (s); return whether it has become too much just now."""
        self.share += WEIGHT * (min(thinking / period, MOST) - self.share)
        was_too_much = self._is_too_much
        self._is_too_much = self.share > (0.5 * SPARE if was_too_much else SPARE)
        return self._is_too_much and not was_too_much

    @property
    def speed_factor(self) -> float:
        """Share of the speed it was asked for that a robot may drive."""
        return min(1.0, SPARE / self.share) if self.share > 0.0 else 1.0


class CyclePeriod:
    """How long a velocity is driven by: the control period, or several where cycles come so much more seldom.

    They do on a clock that ticks more slowly than that, as Stage's, whose 10 Hz are half of what most files ask for. A
    controller that reckons with the shorter time then speeds up and brakes half as hard, and a cycle too late.
    """

    def __init__(self) -> None:
        self._last = -math.inf
        self._passed: Deque[float] = collections.deque([1.0], maxlen=3)

    def note(self, now: float, period: float) -> float:
        """Take a cycle at `now` (s) and the period asked for (s); return the period kept, a multiple of that."""
        passed, self._last = (now - self._last) / period, now
        if 0.0 < passed < MOST:  # else a drive began, or the clock was set
            self._passed.append(passed)
        middle = sorted(self._passed)[(len(self._passed) - 1) // 2]
        return max(1, round(middle)) * period
