"""Warnings of something that goes on: said now and then, and not at all of what is only still starting."""

from __future__ import annotations

import time

import rospy

START_PATIENCE = 15.0
"""Wall seconds in which a graph may come up before what is missing is worth a warning."""
PERIOD = 5.0
"""Wall seconds between two warnings of one kind."""


class Complaints:
    """Warns of one kind of trouble, at most once in a while.

    Until the thing has worked once, and no longer than a graph needs to come up, trouble is only told at debug level.
    """

    def __init__(self, period: float = PERIOD, start_patience: float = START_PATIENCE) -> None:
        self._period = period
        self._quiet_until = time.monotonic() + start_patience
        self._next = 0.0

    def worked(self) -> None:
        """Note that the thing works, so that from now on its trouble is news."""
        self._quiet_until = 0.0

    def say(self, text: str) -> None:
        """Tell of trouble."""
        now = time.monotonic()
        if now < self._quiet_until:
            rospy.logdebug("%s", text)
        elif now >= self._next:
            self._next = now + self._period
            rospy.logwarn("%s", text)
