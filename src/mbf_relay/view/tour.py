"""A list of waypoints, driven in turn, once or repeatedly, with a pause at each."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Sequence

from mbf_relay.geometry import Pose2D


class Tour:
    """Decides which waypoint to send as a goal, and when.

    Args:
        waypoints: Poses in the map frame.
        loop: Whether to start over after the last one.
        pause: Seconds to wait at each.
    """

    def __init__(self, waypoints: Sequence[Pose2D], loop: bool, pause: float) -> None:
        self.waypoints: List[Pose2D] = list(waypoints)
        self._loop, self._pause = loop, pause
        self._index = -1
        self._go_on_at: Optional[float] = 0.0

    @property
    def is_over(self) -> bool:
        """Whether the last waypoint was reached, without `loop`."""
        return self._index + 1 >= len(self.waypoints) and not self._loop and self._go_on_at is not None

    def next_goal(self, now: float) -> Optional[Pose2D]:
        """Return the goal to send at `now` (s); None while one runs, during a pause, and after the last."""
        if self._go_on_at is None or now < self._go_on_at or self.is_over:
            return None
        self._index = (self._index + 1) % len(self.waypoints)
        self._go_on_at = None
        return self.waypoints[self._index]

    def reached(self, now: float) -> None:
        """Note that the current goal was reached at `now` (s)."""
        last = self._index + 1 == len(self.waypoints) and not self._loop
        self._go_on_at = now if last else now + self._pause

    def as_dict(self) -> Dict[str, Any]:
        """Return what the page shows."""
        return {
            "waypoints": [[round(value, 3) for value in pose] for pose in self.waypoints], "index": self._index,
            "loop": self._loop, "pausing": self._go_on_at is not None,
        }
