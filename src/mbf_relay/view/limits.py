"""Rate limit for one browser's messages."""

from __future__ import annotations


class RateLimit:
    """A token bucket.

    Args:
        rate: Sustained requests per second.
        burst: Requests allowed at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._level, self._last = burst, 0.0

    def allows(self, now: float) -> bool:
        """Count a request at `now` (s) and return whether it is within the limit."""
        self._level = min(self._burst, self._level + max(0.0, now - self._last) * self._rate)
        self._last = now
        if self._level < 1.0:
            return False
        self._level -= 1.0
        return True
