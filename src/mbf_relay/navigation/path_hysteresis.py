"""Hysteresis between replans: a path that passes obstacles on another side must be found for a while to be taken."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.navigation import hysteresis_kernels

PATIENCE = 0.5
"""Seconds for which all replans must lead another way before the first change; doubled by each change nearby."""
DOUBLINGS = 5
"""Number of changes near one place after which the patience no longer doubles."""
PLACE = 4.5
"""Distance (in robot widths) from the last change within which a further change counts as nearby."""
AHEAD = 13.0
"""Length (in robot widths) of the paths that is compared; later differences can be decided on later."""
SPACING = 0.22
"""Approximate distance (in robot widths) between compared points."""


class PathHysteresis:
    """Keeps a robot on its way while replans alternate between two.

    A passage hardly wider than the robot is free in one costmap snapshot and blocked in the next, with one cell more
    marked. A robot that follows each replan turns back and forth before two such passages and enters neither. So a path
    along the same way is taken at once, and one along another way only when all replans led there for PATIENCE. Each
    further change near the last one doubles that time, so that the robot gets far enough to see whether it fits.
    """

    def __init__(self) -> None:
        self._since: Optional[float] = None
        self._changes = 0
        self._changed_at: Optional[Pose2D] = None

    def restart(self) -> None:
        """Start the waiting time over: a new path is begun, or the last plan led along the same way."""
        self._since = None

    def wants(self, now: float, robot: Pose2D, width: float) -> bool:
        """Return whether to change to another way now; call it for each plan that leads another way.

        Args:
            now: Time (s).
            robot: The robot's pose in the paths' frame.
            width: The robot's width (m).
        """
        if self._since is None or now < self._since:
            self._since = now
        near_last = self._changed_at is not None and self._changed_at.distance_to(robot) < PLACE * width
        changes = self._changes if near_last else 0
        if now - self._since < PATIENCE * 2.0 ** min(changes, DOUBLINGS):
            return False
        self._since, self._changes, self._changed_at = None, changes + 1, robot
        return True


def leads_another_way(old: np.ndarray, new: np.ndarray, robot: Pose2D, width: float) -> bool:
    """Return whether a new path passes an obstacle on another side than the rest of the last one.

    False for a robot farther than two widths from the last path: it has left it anyway.

    Args:
        old, new: Poses, shape (N, 3) and (M, 3), in one frame.
        robot: The robot's pose in that frame.
        width: The robot's width (m). Paths on different sides of an obstacle are at least that far apart.
    """
    distances = np.hypot(old[:, 0] - robot.x, old[:, 1] - robot.y)
    nearest = int(distances.argmin())
    return bool(distances[nearest] <= 2.0 * width and not is_same_way(old[nearest:], new, width))


def is_same_way(old: np.ndarray, new: np.ndarray, width: float) -> bool:
    """Return whether two paths from the robot on, (N, 3) and (M, 3), stay within `width` (m) of each other."""
    sides = []
    for poses in (old, new):
        poses = np.ascontiguousarray(poses, dtype=float)
        arcs = np.empty(len(poses))
        path_kernels.measure(poses, arcs)
        sides += [poses, arcs]
    return bool(hysteresis_kernels.is_same_way(*sides, AHEAD * width, SPACING * width, width))


def path_is_blocked(costmap: CostGrid, poses: np.ndarray, robot: Optional[Pose2D]) -> bool:
    """Return whether a path leads through cells where the robot's centre must not be.

    Args:
        costmap: Snapshot of a costmap.
        poses: Shape (N, 3), in the costmap's frame.
        robot: The robot's pose there; only poses after the one nearest to it count. None for the whole path.
    """
    if robot is not None:
        distances = np.hypot(poses[:, 0] - robot.x, poses[:, 1] - robot.y)
        poses = poses[int(distances.argmin()) + 1:]
    return bool(costmap.blocks(poses).any())
