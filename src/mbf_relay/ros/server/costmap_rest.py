"""Stopping the costmaps while the server has nothing to do (shutdown_costmaps)."""

from __future__ import annotations

import math
import threading
from typing import Mapping

from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.costmap.node import CostmapNode
from mbf_relay.timing import Stopwatch


class CostmapRest:
    """Lets costmaps rest some time after the last goal or request, and wakes them at the next one.

    Args:
        nodes: The costmaps' nodes.
        clear: Whether what was observed is forgotten at rest, as clear_on_shutdown asks.
    """

    def __init__(self, nodes: Mapping[str, CostmapNode], clear: bool) -> None:
        self._nodes, self._clear = nodes, clear
        self._lock = threading.Lock()  # guards the two below; the costmaps' own locks are taken inside it
        self._resting = False
        self._idle_since = Stopwatch()

    def attend(self, now: float, idle: bool, parameters: NavigatorParameters) -> float:
        """Rest or wake the costmaps as needed; return the time (s) to call again."""
        if not idle or not parameters.shutdown_costmaps:
            self.wake()
            return math.inf
        with self._lock:
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

    def wake(self) -> bool:
        """Let the costmaps work; return whether they rested."""
        with self._lock:
            self._idle_since.reset()
            if not self._resting:
                return False
            self._resting = False
            for node in self._nodes.values():
                node.resume()
            return True
