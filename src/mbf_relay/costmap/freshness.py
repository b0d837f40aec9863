"""Whether a costmap was updated recently enough for driving and planning."""

from __future__ import annotations

import math
from typing import Optional

from mbf_relay.timing import SET_BACK

LEAST_ALLOWED, PERIODS_ALLOWED = 1.0, 5.0
"""Largest age of a costmap: this many seconds or this many periods of its updates, whichever is longer."""

FIRST_TRIES = 1.0
"""Least frequency (Hz) of attempts until the first update, which may have to wait for a pose."""


def next_update(now: float, frequency: float, updates: int) -> float:
    """Return the time (s) of a costmap's next update.

    Args:
        now: Time (s) of the last attempt.
        frequency: Its update_frequency (Hz); 0 for a single update.
        updates: Number of updates so far.
    """
    if updates:
        return now + 1.0 / frequency if frequency else math.inf
    return now + 1.0 / max(frequency, FIRST_TRIES)


class Freshness:
    """When a costmap was last updated, and why it has not been since.

    Attributes:
        updated: Time (s) of the last update; None before the first.
        updates: Number of updates.
        failure: Why no update is possible at present; empty where that is not known.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.updated: Optional[float] = None
        self.updates, self.failure = 0, ""

    def note(self, now: float) -> None:
        """Record an update at time `now` (s)."""
        self.updated, self.failure = now, ""
        self.updates += 1

    def never(self, why: str) -> str:
        """Return the error for a costmap never updated, with the reason `why`; where that is empty, with `failure`."""
        reason = why or self.failure
        return f"{self._name} was not updated yet" + (f": {reason}" if reason else "")

    def trouble(self, now: float, frequency: float, resting: float) -> Optional[str]:
        """Return the error for a costmap that is too old or was never updated; None where it is recent enough.

        Args:
            now: Time (s).
            frequency: Its update_frequency (Hz).
            resting: Largest age (s) where the frequency is 0.
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
