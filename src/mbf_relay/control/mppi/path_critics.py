"""Critics of the path: distance from it, progress along it, and heading to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbf_relay.control.mppi.critic import POINT_SPACING, CriticFunction, CriticParameters, Rollouts
from mbf_relay.geometry import normalize_angles
from mbf_relay.parameters import parameter

FORWARD, EITHER_WAY, AS_PLANNED = 0, 1, 2
"""Values of PathAngleCritic's `mode`."""
AT_ONCE = 0.15
"""Share of PathFollowCritic's cost that is taken after half the time. With less, a robot that a wall ends the way of
stands off it, always planning to drive up to it later."""


@dataclass(frozen=True)
class PathAlignCriticParameters(CriticParameters):
    """Parameters of MPPI's PathAlignCritic."""

    cost_weight: float = parameter(10.0, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        0.5, "distance to the goal below which this critic is off", "m", minimum=0.0)
    offset_from_furthest: int = parameter(
        20, "this critic is off until a trajectory reaches this many points (5 cm apart) along the path", minimum=0)
    trajectory_point_step: int = parameter(4, "every how many steps a trajectory is compared with the path", minimum=1)
    max_path_occupancy_ratio: float = parameter(
        0.07, "share of the path ahead that may be blocked before this critic is off, so that trajectories may leave "
        "the path", minimum=0.0, maximum=1.0)
    use_path_orientations: bool = parameter(
        False, "also charge the angle to the path's direction, a radian as much as a metre")


class PathAlignCritic(CriticFunction):
    """Charges the mean distance between points of each trajectory and of the path at equal arc lengths."""

    Parameters = PathAlignCriticParameters
    parameters: PathAlignCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres."""
        p = self.parameters
        if data.goal_distance < p.threshold_to_consider or data.furthest < max(1, p.offset_from_furthest):
            return 0.0
        blocked = int((~data.path_is_free[: data.furthest]).sum())
        if blocked > 2 and blocked > p.max_path_occupancy_ratio * data.furthest:
            return 0.0
        poses = data.poses[:, :: p.trajectory_point_step]
        x, y = poses[:, :, 0].copy(), poses[:, :, 1].copy()  # contiguous copies are read three times as fast
        driven = np.cumsum(np.hypot(np.diff(x), np.diff(y)), axis=1)
        points = np.minimum((driven / POINT_SPACING + 0.5).astype(np.int64), data.furthest)
        path_x, path_y = data.path.T.copy()
        squares = (x[:, 1:] - path_x[points]) ** 2 + (y[:, 1:] - path_y[points]) ** 2
        if p.use_path_orientations:
            squares += normalize_angles(poses[:, 1:, 2] - _directions(data.path)[points]) ** 2
        valid = data.path_is_free[points]
        return (np.sqrt(squares) * valid).sum(axis=1) / np.maximum(1, valid.sum(axis=1))


@dataclass(frozen=True)
class PathFollowCriticParameters(CriticParameters):
    """Parameters of MPPI's PathFollowCritic."""

    cost_weight: float = parameter(5.0, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        1.4, "distance to the goal below which this critic is off", "m", minimum=0.0)
    offset_from_furthest: int = parameter(
        6, "how many points (5 cm apart) beyond the one reached by the farthest trajectory the aimed-at point lies",
        minimum=0)


class PathFollowCritic(CriticFunction):
    """Charges the distance from a trajectory's end to a point of the path beyond what any of them reaches.

    It is measured along the path and across it, since where a path folds back a point beside it may lie much farther
    along; and after half the time as well, so that early progress is preferred: a robot that can do with progress late
    in the horizon puts it off again in the next cycle.
    """

    Parameters = PathFollowCriticParameters
    parameters: PathFollowCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres."""
        if data.goal_distance < self.parameters.threshold_to_consider:
            return 0.0
        last = len(data.path) - 1
        aim = min(data.furthest + self.parameters.offset_from_furthest, last)
        while aim < last and not data.path_is_free[aim]:
            aim += 1
        arc = aim * POINT_SPACING
        halfway, end = (np.hypot(places[:, 0], arc - places[:, 1]) for places in (data.halfway, data.ends))
        return AT_ONCE * halfway + (1.0 - AT_ONCE) * end


@dataclass(frozen=True)
class PathAngleCriticParameters(CriticParameters):
    """Parameters of MPPI's PathAngleCritic."""

    cost_weight: float = parameter(2.2, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        0.5, "distance to the goal below which this critic is off", "m", minimum=0.0)
    offset_from_furthest: int = parameter(
        4, "how many points (5 cm apart) beyond the one reached by the farthest trajectory the faced point lies",
        minimum=0)
    max_angle_to_furthest: float = parameter(
        0.785398, "angle to the faced point below which this critic is off", "rad", minimum=0.0)
    mode: int = parameter(
        FORWARD, "0: face the point with the front; 1: with front or back; 2: with the end the path's direction asks "
        "for", choices=(FORWARD, EITHER_WAY, AS_PLANNED))


class PathAngleCritic(CriticFunction):
    """Charges the angle between the heading at a trajectory's end and the bearing of a point ahead on the path.

    It is off while the robot faces that point within max_angle_to_furthest.
    """

    Parameters = PathAngleCriticParameters
    parameters: PathAngleCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return radians."""
        p, pose = self.parameters, data.pose
        if data.goal_distance < p.threshold_to_consider:
            return 0.0
        index = min(data.furthest + p.offset_from_furthest, len(data.path) - 1)
        x, y = data.path[index]
        direction = _directions(data.path)[index]
        if _off(p.mode, direction, np.arctan2(y - pose.y, x - pose.x), pose.theta) < p.max_angle_to_furthest:
            return 0.0
        ends_x, ends_y, headings = (data.poses[:, -1, component].copy() for component in range(3))
        return _off(p.mode, direction, np.arctan2(y - ends_y, x - ends_x), headings)


def _off(mode: int, direction: float, bearings: Any, headings: Any) -> Any:
    """Return the angles (rad, 0 to pi) by which robots do not face a point of the path.

    Args:
        mode: PathAngleCritic's.
        direction: The path's (rad) at the point.
        bearings: Of the point (rad) from each robot.
        headings: Of the robots (rad).
    """
    angles = np.abs(normalize_angles(bearings - headings))
    if mode == EITHER_WAY:
        return np.minimum(angles, math.pi - angles)
    if mode == AS_PLANNED:
        backwards = np.abs(normalize_angles(bearings - direction)) >= math.pi / 2.0
        return np.where(backwards, math.pi - angles, angles)
    return angles


def _directions(path: np.ndarray) -> np.ndarray:
    """Return the direction (rad) of a path at each of its points, shape (P,)."""
    steps_x, steps_y = np.diff(path, axis=0).T.copy()
    directions = np.arctan2(steps_y, steps_x)
    return np.append(directions, directions[-1])
