"""The progress of the current goal: planning, driving or recovering, and distance and time left."""

from __future__ import annotations

from typing import Any, Dict, Optional

import numpy as np

from mbf_relay.geometry import Pose2D

FRESH = 2.0
"""Seconds after a message, such as a plan, for which its activity is shown; plans come every second at least."""
SPEED_SMOOTHING = 5.0
"""Time constant (s) of the average speed, by which the time left is estimated."""
MOVING = 0.02
"""Average speed (m/s) below which no time left is shown."""


class GoalStory:
    """Follows goals by messages on topics. All times (s) must be of one clock.

    Attributes:
        goal: The last goal, in the map frame.
        state: idle, active, reached, cancelled or failed.
        outcome: The text of the last goal's end.
    """

    def __init__(self) -> None:
        self._signs: Dict[str, float] = {}
        self._recovery = ""
        self._path: Optional[np.ndarray] = None
        self._speed: Optional[float] = None
        self._speed_time = 0.0
        self.goal: Optional[Pose2D] = None
        self.state = "idle"
        self.outcome = ""

    def began(self, goal: Optional[Pose2D]) -> None:
        """Note that a goal is active; `goal` is in the map frame, None where not known."""
        if self.state != "active":
            self.state, self.outcome, self._recovery, self._path = "active", "", "", None
            self._signs.clear()
        self.goal = goal if goal is not None else self.goal

    def ended(self, state: str, outcome: str) -> None:
        """Note that the goal has ended: `state` is reached, cancelled or failed, `outcome` the text."""
        self.state, self.outcome, self._recovery, self._path = state, outcome, "", None

    def planned(self, path: np.ndarray, now: float) -> None:
        """Note a plan: points in the map frame (m), shape (N, 2)."""
        self._signs["planning"] = now
        self._recovery = ""
        self._path = path if len(path) > 1 else None

    def drove(self, now: float) -> None:
        """Note that the controller is working."""
        self._signs["driving"] = now

    def recovers(self, name: str, now: float) -> None:
        """Note that a recovery behaviour has started."""
        self._signs["recovering"] = now
        self._recovery = name

    def moves(self, speed: float, now: float) -> None:
        """Note the robot's speed (m/s)."""
        share = min(1.0, max(0.0, now - self._speed_time) / SPEED_SMOOTHING)
        self._speed = abs(speed) if self._speed is None else self._speed + share * (abs(speed) - self._speed)
        self._speed_time = now

    def as_dict(self, pose: Optional[Pose2D], now: float) -> Dict[str, Any]:
        """Return what the page shows; `pose` is the robot's in the map frame."""
        active = self.state == "active"
        left = length_left(self._path, pose) if active and self._path is not None and pose is not None else None
        moving = self._speed is not None and self._speed > MOVING
        return {
            "state": self.state, "outcome": self.outcome,
            "goal": [round(value, 3) for value in self.goal] if self.goal is not None and active else None,
            "planning": active and not self._recovery and self._is_fresh("planning", now),
            "driving": active and not self._recovery and self._is_fresh("driving", now),
            "recovering": self._recovery if active else "",
            "left": None if left is None else round(left, 2),
            "time_left": round(left / self._speed, 1) if left is not None and moving and self._speed else None,
        }

    def _is_fresh(self, sign: str, now: float) -> bool:
        return sign in self._signs and now - self._signs[sign] < FRESH


def length_left(path: np.ndarray, pose: Pose2D) -> float:
    """Return the distance (m) to the nearest point of a path, shape (N, 2), and along it to its end."""
    nearest = int(np.argmin(np.hypot(path[:, 0] - pose.x, path[:, 1] - pose.y)))
    rest = path[nearest:]
    along = float(np.hypot(*np.diff(rest, axis=0).T).sum()) if len(rest) > 1 else 0.0
    return along + float(np.hypot(rest[0, 0] - pose.x, rest[0, 1] - pose.y))
