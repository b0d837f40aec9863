"""Headings along a path: global_planner's orientation modes."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between, normalize_angles

STRAIGHT_ON = 0.35
"""Turn (rad) that ends the last straight part of a path for FORWARD_THEN_INTERPOLATE, as in global_planner."""


class OrientationMode(IntEnum):
    """How a path's poses head; the last one always heads as the goal does."""

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
"""Angle from the path's direction to the robot's heading."""


def oriented(points: np.ndarray, start: Pose2D, goal: Pose2D, mode: int = 1, window: int = 1) -> np.ndarray:
    """Return poses (N, 3) over points (N, 2), in metres and radians.

    Args:
        points: The path, at least one point.
        start, goal: Their headings are used where the mode says so; the last pose heads as `goal`.
        mode: An OrientationMode.
        window: Over how many points back and ahead the path's direction is taken.
    """
    count = len(points)
    poses = np.empty((count, 3))
    poses[:, :2] = points
    headings: np.ndarray = np.zeros(0)
    if mode in TURNED:
        headings = normalize_angles(directions(points, window) + TURNED[OrientationMode(mode)])
    if mode == OrientationMode.INTERPOLATE:
        headings = _blend(start.theta, goal.theta, count)
    elif mode == OrientationMode.FORWARD_THEN_INTERPOLATE:
        first = _last_straight(headings)
        headings[first:] = _blend(headings[first], goal.theta, count - first)
    poses[:, 2] = headings if len(headings) else 0.0
    poses[-1, 2] = math.atan2(math.sin(goal.theta), math.cos(goal.theta))
    return poses


def directions(points: np.ndarray, window: int) -> np.ndarray:
    """Return the path's direction (rad) at each point: from `window` points before it to as many after it."""
    before, after = points[:1].repeat(window, axis=0), points[-1:].repeat(window, axis=0)  # as if it stood at the ends
    padded = np.concatenate((before, points, after))
    steps_x, steps_y = (padded[2 * window:] - padded[:-2 * window]).T.copy()
    headings: np.ndarray = np.arctan2(steps_y, steps_x)
    return headings


def _blend(first: float, last: float, count: int) -> np.ndarray:
    return normalize_angles(first + angle_between(first, last) * np.linspace(0.0, 1.0, max(count, 1)))


def _last_straight(headings: np.ndarray) -> int:
    """Return the index from which the path goes straight on to its end."""
    first = max(len(headings) - 3, 0)
    final = headings[first]
    while first > 0 and abs(angle_between(headings[first - 1], final)) <= STRAIGHT_ON:
        first -= 1
    return first
