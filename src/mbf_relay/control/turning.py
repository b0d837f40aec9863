"""Turning on the spot: how fast, and which way round."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D


def turn_rate(error: float, rate: float, parameters: FollowerParameters, period: float, top: float) -> float:
    """Return the rotational velocity to command in order to turn by `error` and stand still there.

    It is the fastest from which the robot can brake in time, within acceleration. Below min_vel_theta it only starts
    and brakes: a robot that stands and is off by more than its tolerance gets at least that much, or what acceleration
    allows.

    Args:
        error: Turn left (rad), positive to the left.
        rate: Present rotational velocity (rad/s).
        parameters: Limits.
        period: Seconds the command will hold.
        top: Top rotational speed (rad/s) for now.
    """
    change = parameters.acc_lim_theta * period
    wanted = min(top, speed_to_stop_within(abs(error), parameters.acc_lim_theta, period))
    brakes = rate * error > 0.0 and abs(rate) > wanted
    if not brakes:
        wanted = max(wanted, min(parameters.min_vel_theta, top, abs(error) / period))
    return min(rate + change, max(rate - change, math.copysign(wanted, error)))


def free_turn(checker: FootprintChecker, pose: Pose2D, angle: float) -> float:
    """Return how much of a turn on the spot by `angle` (rad) is free, as an angle of 0 or above."""
    count = max(1, math.ceil(abs(angle) / checker.turn_step))
    headings = pose.theta + np.linspace(angle / count, angle, count)
    poses = np.column_stack((np.full(count, pose.x), np.full(count, pose.y), headings))
    return abs(angle) / count * checker.free_steps(poses, pose)


def free_way_round(checker: FootprintChecker, pose: Pose2D, error: float) -> Optional[float]:
    """Return the turn (rad) that leads to a heading `error` away without touching.

    The short way, the long one, or None.
    """
    if free_turn(checker, pose, error) >= abs(error) - 1e-9:
        return error
    other = error - math.copysign(2.0 * math.pi, error)
    if free_turn(checker, pose, other) >= abs(other) - 1e-9:
        return other
    return None
