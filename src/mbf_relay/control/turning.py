"""Turning on the spot: how fast, and which way round."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, angle_between

SOON = 1.0
"""Seconds after a turn within which the opposite one makes up for it: longer than commands come late."""
LEAST_TURN, LEAST_SPEED = 1.0 / 16.0, 1.0 / 4.0
"""Of the top speeds, to which turns and the way to the goal are slowed down at most."""


class Overshoot:
    """Notices that the robot turns past where it shall, back and forth, or slides past the goal.

    Commands that come late have it so, and nothing tells how late. Each time the next turns, or the way back to the
    goal, are half as fast, and soon end where they shall.

    Attributes:
        speed_share: Of the top translational speed, for now.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what happened."""
        self._way, self._heading, self._turned_at, self._turn_share = 0.0, 0.0, -math.inf, 1.0
        self.speed_share = 1.0

    def slid(self) -> None:
        """Note that the robot was at the goal and is there no more."""
        self.speed_share = max(LEAST_SPEED, 0.5 * self.speed_share)

    def interrupted(self) -> None:
        """Note that something else than the last turn decides where the robot faces next."""
        self._turned_at = -math.inf

    def turn_share(self, now: float, heading: float, way: float) -> float:
        """Note a turn and return the share of the top rotational speed for it.

        Args:
            now: Time (s).
            heading: Where the robot faces (rad): a way back that is longer than twice what it turned too far is no
                overshoot, for where it shall face lies elsewhere now.
            way: What is left to turn (rad).
        """
        left = self._way - angle_between(self._heading, heading)
        past = left * self._way < 0.0 and left * way > 0.0 and abs(way) <= 2.0 * abs(left)
        if past and 0.0 <= now - self._turned_at <= SOON:
            self._turn_share = max(LEAST_TURN, 0.5 * self._turn_share)
        self._way, self._heading, self._turned_at = way, heading, now
        return self._turn_share


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
