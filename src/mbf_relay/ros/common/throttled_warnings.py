"""Warnings of trouble that lasts, and not of what is over within a second or belongs to the start of the graph."""

from __future__ import annotations

import time
from typing import Callable, Optional

import rospy

START_PATIENCE = 15.0
"""Wall seconds in which all nodes should have started; missing data is no warning before."""
HICCUP = 1.0
"""Wall seconds for which trouble must last before there is a warning; a busy machine causes shorter ones."""
PERIOD = 5.0
"""Wall seconds between two warnings."""


class ThrottledWarnings:
    """Warns of one kind of trouble, at most once in PERIOD.

    Trouble shorter than HICCUP is logged at debug level, and so is all trouble within START_PATIENCE of the start,
    until things have worked for the first time.

    Args:
        clock: Gives wall time (s).
        warn: Takes a format and its argument.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, warn: Callable[[str, str], None] = rospy.logwarn
    ) -> None:
        self._clock, self._warn = clock, warn
        self._quiet_until = clock() + START_PATIENCE
        self._since: Optional[float] = None
        self._next = -float("inf")

    def worked(self) -> None:
        """Note that there is no trouble; call it each time things work."""
        self._quiet_until = -float("inf")
        self._since = None

    def say(self, text: str) -> None:
        """Report trouble; call it each time it occurs."""
        now = self._clock()
        self._since = now if self._since is None else self._since
        if now < self._quiet_until or now - self._since < HICCUP or now < self._next:
            rospy.logdebug("%s", text)
        else:
            self._next = now + PERIOD
            self._warn("%s", text)
