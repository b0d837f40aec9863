"""Counting of collisions: one rule for the simulator, lockstep drives and reports."""

from __future__ import annotations

import math
from typing import Dict

APART = 1.0
"""Time (s) without contact after which touching the same thing is a new collision: bouncing along a wall is one."""


class Touched:
    """Time of the last contact with each thing."""

    def __init__(self) -> None:
        self._last: Dict[str, float] = {}

    def note_contact(self, name: str, now: float) -> bool:
        """Record a contact at `now` (s) and return whether it is a new collision.

        It is after more than APART without contact, and where the clock was set back.
        """
        last, self._last[name] = self._last.get(name, -math.inf), now
        return not 0.0 <= now - last <= APART
