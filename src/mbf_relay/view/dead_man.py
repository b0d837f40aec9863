"""The dead man's switch of teleoperation: a velocity holds only while a browser keeps sending it."""

from __future__ import annotations

from typing import Hashable, Optional

from mbf_relay.geometry import STOP, Twist2D

PATIENCE = 0.2
"""Seconds for which a velocity holds; with the checking period and the latency to the wheels, less than 0.3 s."""


class DeadMan:
    """Gives the velocity to command. One browser drives at a time, until it releases the stick or falls silent."""

    def __init__(self) -> None:
        self._holder: Optional[Hashable] = None
        self._velocity = STOP
        self._deadline = 0.0

    @property
    def holder(self) -> Optional[Hashable]:
        """Who is driving, None for nobody."""
        return self._holder

    def push(self, who: Hashable, velocity: Twist2D, now: float) -> bool:
        """Take a velocity at `now` (s); return False where somebody else is driving."""
        if self._holder not in (None, who):
            return False
        self._holder, self._velocity, self._deadline = who, velocity, now + PATIENCE
        return True

    def release(self, who: Hashable) -> Optional[Twist2D]:
        """Stop driving; return the zero velocity to command, None where `who` was not driving."""
        if self._holder != who or who is None:
            return None
        self._holder, self._velocity = None, STOP
        return STOP

    def command(self, now: float) -> Optional[Twist2D]:
        """Return the velocity to command at `now` (s): zero, once, after PATIENCE; None where nobody drives."""
        if self._holder is None:
            return None
        if now >= self._deadline:
            return self.release(self._holder)
        return self._velocity
