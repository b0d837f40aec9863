"""The dead man's switch: a velocity holds only as long as somebody keeps asking for it."""

from __future__ import annotations

from typing import Hashable, Optional

from mbf_relay.geometry import STOP, Twist2D

PATIENCE = 0.2
"""Seconds a wish holds. With the watch's period and the way to the wheels that stays under the 0.3 s promised."""


class DeadMan:
    """Says what velocity to command. One hand drives at a time, and who let go has stopped."""

    def __init__(self) -> None:
        self._holder: Optional[Hashable] = None
        self._velocity = STOP
        self._deadline = 0.0

    @property
    def holder(self) -> Optional[Hashable]:
        """Whose hand is on the stick."""
        return self._holder

    def push(self, who: Hashable, velocity: Twist2D, now: float) -> bool:
        """Take a wish at `now` (s); return False where another hand is on the stick."""
        if self._holder not in (None, who):
            return False
        self._holder, self._velocity, self._deadline = who, velocity, now + PATIENCE
        return True

    def release(self, who: Hashable) -> Optional[Twist2D]:
        """Let go; return the zero to command, None where this hand was not on the stick."""
        if self._holder != who or who is None:
            return None
        self._holder, self._velocity = None, STOP
        return STOP

    def command(self, now: float) -> Optional[Twist2D]:
        """Return the velocity to command at `now` (s): zero, once, where the wish is too old; None where nobody drives.
        """
        if self._holder is None:
            return None
        if now >= self._deadline:
            return self.release(self._holder)
        return self._velocity
