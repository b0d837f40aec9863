"""A path: the poses that a robot is to pass, in order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbf_relay.geometry import Pose2D


@dataclass(frozen=True)
class Path:
    """Poses in one frame; treat as read-only.

    Attributes:
        poses: Shape (N, 3), float64: x, y in metres, theta in radians.
        frame: Frame of the poses.
        cost: Its cost, in the planner's own unit.
    """

    poses: np.ndarray
    frame: str
    cost: float = 0.0

    def __len__(self) -> int:
        return len(self.poses)

    @cached_property
    def length(self) -> float:
        """Length (m) along the path."""
        steps = np.diff(self.poses[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    @cached_property
    def goal(self) -> Pose2D:
        """The last pose."""
        return Pose2D(*map(float, self.poses[-1]))
