"""Turning on the spot: the rotational velocity, and the free direction."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D


def turn_rate(error: float, rate: float, parameters: FollowerParameters, period: float, top: float) -> float:
    """Return the rotational velocity (rad/s) that turns by `error` and stops there.

    It is the highest from which the robot can brake in time, within acceleration, and at least min_vel_theta unless the
    robot is braking, or that would overshoot within the period.

    Args:
        error: Remaining angle (rad), positive to the left.
        rate: Present rotational velocity (rad/s).
        parameters: Limits.
        period: Time (s) for which the command holds.
        top: Top rotational speed (rad/s).
    """
    change = parameters.acc_lim_theta * period
    wanted = min(top, speed_to_stop_within(abs(error), parameters.acc_lim_theta, period))
    brakes = rate * error > 0.0 and abs(rate) > wanted
    if not brakes:
        wanted = max(wanted, min(parameters.min_vel_theta, top, abs(error) / period))
    return min(rate + change, max(rate - change, math.copysign(wanted, error)))


def free_turn(checker: FootprintChecker, pose: Pose2D, angle: float) -> float:
    """Return the angle (rad, 0 or above) up to which a turn on the spot by `angle` is free."""
    count = max(1, math.ceil(abs(angle) / checker.turn_step))
    headings = pose.theta + np.linspace(angle / count, angle, count)
    poses = np.column_stack((np.full(count, pose.x), np.full(count, pose.y), headings))
    return abs(angle) / count * checker.free_steps(poses, pose)


def free_way_round(checker: FootprintChecker, pose: Pose2D, error: float) -> Optional[float]:
    """Return the turn (rad) to a heading `error` (rad) away that is free: the short one, else the long one, else None.
    """
    if free_turn(checker, pose, error) >= abs(error) - 1e-9:
        return error
    other = error - math.copysign(2.0 * math.pi, error)
    if free_turn(checker, pose, other) >= abs(other) - 1e-9:
        return other
    return None
