"""Stopping the costmaps while the server has nothing to do (shutdown_costmaps)."""

from __future__ import annotations

import math
import threading
from typing import Mapping

from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.costmap.node import CostmapNode
from mbf_relay.timing import Stopwatch


class CostmapRest:
    """Stops the costmaps' updates shutdown_costmaps_delay after the last goal or request, and resumes them at the next.

    Args:
        nodes: The costmaps' nodes.
        clear: Whether to clear obstacles when they stop (clear_on_shutdown).
    """

    def __init__(self, nodes: Mapping[str, CostmapNode], clear: bool) -> None:
        self._nodes, self._clear = nodes, clear
        self._lock = threading.Lock()  # guards the two below; the costmaps' own locks are taken inside it
        self._resting = False
        self._idle_since = Stopwatch()

    def attend(self, now: float, idle: bool, parameters: NavigatorParameters) -> float:
        """Stop or resume the costmaps as needed; return the time (s) at which to call again.

        Args:
            now: ROS time (s).
            idle: Whether no goal runs.
            parameters: The server's.
        """
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
        """Resume the costmaps; return whether they had been stopped."""
        with self._lock:
            self._idle_since.reset()
            if not self._resting:
                return False
            self._resting = False
            for node in self._nodes.values():
                node.resume()
            return True
