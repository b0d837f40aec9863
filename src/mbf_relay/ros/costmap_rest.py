"""Costmaps that rest while nothing is asked of the server, where the user wants that."""

from __future__ import annotations

import math
from typing import Any, Mapping

from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.timing import Stopwatch


class CostmapRest:
    """Lets costmaps rest some time after the last goal and wakes them at the next one; used by the stepping thread.

    Args:
        nodes: The costmaps' nodes.
        clear: Whether what was observed is forgotten at rest, as clear_on_shutdown asks.
    """

    def __init__(self, nodes: Mapping[str, Any], clear: bool) -> None:
        self._nodes, self._clear = nodes, clear
        self._resting = False
        self._idle_since = Stopwatch()

    def attend(self, now: float, idle: bool, parameters: NavigatorParameters) -> float:
        """Look whether to rest or to wake; returns the time (s) to look again."""
        if not idle or not parameters.shutdown_costmaps:
            self._idle_since.reset()
            self.wake()
            return math.inf
        if self._resting:
            return math.inf
        if not self._idle_since.running:
            self._idle_since.start(now)
        left = parameters.shutdown_costmaps_delay - self._idle_since.elapsed(now)
        if left > 0.0:
            return now + left
        self._resting = True
        for node in self._nodes.values():
            node.rest()
            if self._clear:
                node.costmap.clear()
        return math.inf

    def wake(self) -> None:
        """Let the costmaps work."""
        if self._resting:
            self._resting = False
            self._idle_since.reset()
            for node in self._nodes.values():
                node.resume()
