"""Whether a costmap is young enough to be driven and planned on."""

from __future__ import annotations

import math
from typing import Optional

from mbf_relay.timing import SET_BACK

LEAST_ALLOWED, PERIODS_ALLOWED = 1.0, 5.0
"""Seconds, and periods of its updates if they are longer, that a costmap may be old."""

FIRST_TRIES = 1.0
"""Hz, at least, with which a costmap is tried to be updated until it is for the first time, as when there is a pose."""


def next_update(now: float, frequency: float, updates: int) -> float:
    """Return when a costmap is updated next (s).

    Args:
        now: Time of the last try (s).
        frequency: Of its updates (Hz); 0 for one that is updated once.
        updates: How many there were.
    """
    if updates:
        return now + 1.0 / frequency if frequency else math.inf
    return now + 1.0 / max(frequency, FIRST_TRIES)


class Freshness:
    """When a costmap was updated last, and why it has not been since.

    Attributes:
        updated: Time of the last update (s); None before the first.
        updates: How many there were.
        failure: Why there is no other at present; empty where that is not known.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.updated: Optional[float] = None
        self.updates, self.failure = 0, ""

    def note(self, now: float) -> None:
        """Take note of an update."""
        self.updated, self.failure = now, ""
        self.updates += 1

    def never(self, why: str) -> str:
        """Return that it was not updated yet, and why: for `failure` where that is empty."""
        reason = why or self.failure
        return f"{self._name} was not updated yet" + (f": {reason}" if reason else "")

    def trouble(self, now: float, frequency: float, resting: float) -> Optional[str]:
        """Return why it is too old, or None; where it was never updated, that.

        Args:
            now: Time (s).
            frequency: Of its updates (Hz), 0 for one that is not updated by itself.
            resting: Seconds that such a one may be old.
        """
        if self.updated is None:
            return self.never("")
        age, limit = now - self.updated, resting
        reason = self.failure
        if frequency:
            limit = max(LEAST_ALLOWED, PERIODS_ALLOWED / frequency)
        else:
            reason = reason or "its update_frequency is 0"
        if -SET_BACK <= age <= limit:
            return None
        told = f"{age:.2f} s ago; at most {limit:.2f} s is allowed" if age >= 0.0 else "before time was set back"
        return f"{self._name} was last updated {told}" + (f": {reason}" if reason else "")
