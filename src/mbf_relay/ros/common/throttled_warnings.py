"""Warnings of trouble that lasts: neither of hiccups, nor of what is only still starting."""

from __future__ import annotations

import time
from typing import Callable, Optional

import rospy

START_PATIENCE = 15.0
"""Wall seconds in which a graph may come up before what is missing is worth a warning."""
HICCUP = 1.0
"""Wall seconds of trouble that a busy machine may give without anything being wrong."""
PERIOD = 5.0
"""Wall seconds between two warnings of one kind."""


class ThrottledWarnings:
    """Warns of one kind of trouble, at most once in a while.

    Trouble that is over within a second, or that is there only until the thing has worked for the first time and no
    longer than a graph needs to come up, is told at debug level alone.

    Args:
        clock: The wall clock, for tests.
        warn: Where warnings go, for tests.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, warn: Callable[[str, str], None] = rospy.logwarn
    ) -> None:
        self._clock, self._warn = clock, warn
        self._quiet_until = clock() + START_PATIENCE
        self._since: Optional[float] = None
        self._next = -float("inf")

    def worked(self) -> None:
        """Note that the thing works; call it as often as it does."""
        self._quiet_until = -float("inf")
        self._since = None

    def say(self, text: str) -> None:
        """Tell of trouble; call it as often as there is any."""
        now = self._clock()
        self._since = now if self._since is None else self._since
        if now < self._quiet_until or now - self._since < HICCUP or now < self._next:
            rospy.logdebug("%s", text)
        else:
            self._next = now + PERIOD
            self._warn("%s", text)
