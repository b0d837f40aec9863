"""When a robot touches something anew: one answer for the simulator, for drives without ROS and for reports."""

from __future__ import annotations

import math
from typing import Dict

APART = 1.0
"""Seconds without contact after which the same thing is touched anew: a hull that bounces along a wall touches it once.
"""


class Touched:
    """Remembers when each thing was touched last."""

    def __init__(self) -> None:
        self._last: Dict[str, float] = {}

    def is_anew(self, name: str, now: float) -> bool:
        """Take note of a contact at `now` (s) and return whether the thing is touched anew, not still.

        So it is after APART without contact, and where the clock was set back.
        """
        last, self._last[name] = self._last.get(name, -math.inf), now
        return not 0.0 <= now - last <= APART
