"""Which of two paths to go on along: one that leads another way than the last has to be found for a while first."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.navigation import hysteresis_kernels

PATIENCE = 0.5
"""Seconds for which replans must lead another way before the first change."""
DOUBLINGS = 5
"""Changes at one place after which patience grows no more."""
PLACE = 4.5
"""Robot's widths from the last change within which another one makes patience grow."""
AHEAD = 13.0
"""Robot's widths along the paths that are compared; what comes later can be decided later."""
SPACING = 0.22
"""Robot's widths between compared points, about."""


class PathHysteresis:
    """Holds a robot to its way while replans flip between two.

    A passage hardly wider than the robot looks wide enough in one snapshot and too narrow in the next, as a cell more
    or less is marked. Each replan by itself is right; a robot that follows every one of them turns back and forth
    before two passages and enters neither. So a path along the same way is taken at once, and one along another way
    when replans have led there for PATIENCE without a break; each further change near the last doubles that, so that
    the robot gets far enough into a passage to find out.
    """

    def __init__(self) -> None:
        self._since: Optional[float] = None
        self._changes = 0
        self._changed_at: Optional[Pose2D] = None

    def restart(self) -> None:
        """Forget what was waited for: the robot goes a way anew, or the last plan led along the same."""
        self._since = None

    def wants(self, now: float, robot: Pose2D, width: float) -> bool:
        """Return whether to go over to another way, to which a plan leads at `now` (s).

        Args:
            now: Time (s).
            robot: Where it is, in the paths' frame.
            width: The robot's (m). Paths that pass an obstacle on different sides are at least that far apart.
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
    """Return whether a new path passes something on another side than what is left of the last one.

    Args:
        old, new: Poses, (N, 3) and (M, 3), in one frame.
        robot: Where it is, in that frame. One that is off the last path by twice its width has no way to keep.
        width: The robot's (m).
    """
    distances = np.hypot(old[:, 0] - robot.x, old[:, 1] - robot.y)
    nearest = int(distances.argmin())
    return bool(distances[nearest] <= 2.0 * width and not is_same_way(old[nearest:], new, width))


def is_same_way(old: np.ndarray, new: np.ndarray, width: float) -> bool:
    """Return whether two paths from here on, (N, 3) and (M, 3), stay nearer to each other than `width` (m)."""
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
        costmap: Where the obstacles are.
        poses: Shape (N, 3), in the costmap's frame.
        robot: What lies behind it does not count; the whole path does where None.
    """
    if robot is not None:
        distances = np.hypot(poses[:, 0] - robot.x, poses[:, 1] - robot.y)
        poses = poses[int(distances.argmin()) + 1:]
    return bool(costmap.blocks(poses).any())
