"""Headings along a path: global_planner's orientation modes."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between, normalize_angles
from mbf_relay.planning import points_kernels

STRAIGHT_ON = 0.35
"""Change of direction (rad) at which the last straight part of a path begins; for FORWARD_THEN_INTERPOLATE."""


class OrientationMode(IntEnum):
    """How headings along a path are chosen, numbered as in global_planner; the last pose always has the goal's."""

    NONE = 0
    FORWARD = 1
    INTERPOLATE = 2
    FORWARD_THEN_INTERPOLATE = 3
    BACKWARD = 4
    LEFTWARD = 5
    RIGHTWARD = 6


TURNED = {
    OrientationMode.FORWARD: 0.0,
    OrientationMode.FORWARD_THEN_INTERPOLATE: 0.0,
    OrientationMode.BACKWARD: math.pi,
    OrientationMode.LEFTWARD: -math.pi / 2.0,
    OrientationMode.RIGHTWARD: math.pi / 2.0,
}
"""Angle (rad) from the path's direction to the robot's heading; 0 for modes not listed."""


def oriented(points: np.ndarray, start: Pose2D, goal: Pose2D, mode: int = 1, window: int = 1) -> np.ndarray:
    """Return poses (N, 3) over points (N, 2), in metres and radians.

    Args:
        points: Points of the path, at least one.
        start, goal: Poses whose headings are used where the mode says so; the last pose has that of `goal`.
        mode: An OrientationMode.
        window: The path's direction at a point is that from `window` points before it to as many after it.
    """
    count = len(points)
    points, steps, poses = np.ascontiguousarray(points, dtype=float), np.empty((2, count)), np.empty((count, 3))
    points_kernels.steps_along(points, window, steps)
    points_kernels.head(points, np.arctan2(steps[1], steps[0]), TURNED.get(OrientationMode(mode), 0.0), poses)
    if mode == OrientationMode.NONE:
        poses[:, 2] = 0.0
    elif mode == OrientationMode.INTERPOLATE:
        poses[:, 2] = _blend(start.theta, goal.theta, count)
    elif mode == OrientationMode.FORWARD_THEN_INTERPOLATE:
        first = _last_straight(poses[:, 2])
        poses[first:, 2] = _blend(poses[first, 2], goal.theta, count - first)
    poses[-1, 2] = math.atan2(math.sin(goal.theta), math.cos(goal.theta))
    return poses


def _blend(first: float, last: float, count: int) -> np.ndarray:
    return normalize_angles(first + angle_between(first, last) * np.linspace(0.0, 1.0, max(count, 1)))


def _last_straight(headings: np.ndarray) -> int:
    """Return the index from which the path goes straight on to its end."""
    first = max(len(headings) - 3, 0)
    final = headings[first]
    while first > 0 and abs(angle_between(headings[first - 1], final)) <= STRAIGHT_ON:
        first -= 1
    return first
