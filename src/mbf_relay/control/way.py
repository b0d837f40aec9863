"""Slow, exact tracking of a sequence of poses, such as those the robot came by."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.control.turning import turn_rate
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D, angle_between, normalize_angles

DEEPER = 0.5  # cells by which overlap may exceed that noted: obstacles seen again are marked up to half a cell off
BESIDE = 0.5  # robot's widths along the way within which overlap noted at one pose is allowed at others
STEER = 0.3  # robot's widths of way over which a lateral error is corrected
STEER_CAR = 0.5  # the same for a car, as a share of its minimum turning radius
ON_THE_SPOT = 0.12  # robot's widths: curves of a smaller radius are driven as turns on the spot


class Way:
    """A sequence of poses, and the commands that drive it, forwards, backwards or on the spot.

    Args:
        poses: Shape (S, 3), in the costmap's frame; the first is the robot's.
        depths: Shape (S, 2): overlap (cells) with occupied cells that is allowed at each; see
            FootprintChecker.depths_at.
        width: The robot's width (m).
        radius: Minimum turning radius (m); 0 for a robot that turns on the spot.

    Attributes:
        arcs: Shape (S,): distance (m) driven up to each pose, a turn counting by the way of the robot's side.
    """

    def __init__(self, poses: np.ndarray, depths: np.ndarray, width: float, radius: float = 0.0) -> None:
        self.poses, self._radius = poses, radius
        self._reach = max(STEER * width, STEER_CAR * radius)
        moves = np.diff(poses, axis=0)
        self._turns = normalize_angles(moves[:, 2])
        middle = poses[:-1, 2] + 0.5 * self._turns
        self._ahead = moves[:, 0] * np.cos(middle) + moves[:, 1] * np.sin(middle)
        self._signs = np.where(
            np.abs(self._ahead) < ON_THE_SPOT * width * np.abs(self._turns), 0.0, np.sign(self._ahead))
        rim = np.maximum(np.hypot(moves[:, 0], moves[:, 1]), 0.5 * width * np.abs(self._turns))
        self.arcs = np.concatenate(([0.0], np.cumsum(rim)))
        self._allowed = np.array([
            depths[np.abs(self.arcs - arc) <= BESIDE * width].max(axis=0) for arc in self.arcs]).reshape(-1, 2)
        self._at = 0

    def free_poses(self, checker: FootprintChecker) -> int:
        """Return the number of remaining poses that are free before the first that is not."""
        return self._free(checker, self.poses[self._at:], self._allowed[self._at:])

    def cut(self, last: int) -> None:
        """Drop all poses after the one of index `last`."""
        self.poses, self.arcs, self._allowed = self.poses[:last + 1], self.arcs[:last + 1], self._allowed[:last + 1]

    def command(
        self, pose: Pose2D, velocity: Twist2D, checker: FootprintChecker, parameters: FollowerParameters,
        period: float, speeds: tuple[float, float], top_turn: float,
    ) -> Optional[Twist2D]:
        """Return the next velocity along the way, None at its end or where it is no longer free.

        Args:
            pose, velocity: The robot's present pose (costmap's frame) and velocity (body frame).
            checker: The obstacles.
            parameters: Limits.
            period: Time (s) until the next command.
            speeds: Lowest and highest speed (m/s) along the way.
            top_turn: Top rotational speed (rad/s).
        """
        last = len(self.poses) - 1
        while self._at < last and self._is_past(self._at, pose):
            self._at += 1
        at = self._at
        free = self.free_poses(checker)
        if at == last or free < 2:
            return None
        sign = self._signs[at]
        ends = np.flatnonzero(self._signs[at:last] != sign)
        end = min(at + free - 1, at + int(ends[0]) if len(ends) else last)
        if sign == 0.0:
            left = float(self._turns[at:end].sum()) - angle_between(self.poses[at, 2], pose.theta)
            change = parameters.acc_lim_x * period
            command = Twist2D(
                velocity.x - math.copysign(min(change, abs(velocity.x)), velocity.x), 0.0,
                turn_rate(left, velocity.theta, parameters, period, top_turn))
        else:
            command = self._steered(sign, end, pose, velocity, parameters, period, speeds, top_turn)
        held = period * np.arange(1, 5)[:, None] / 4.0 * np.array(command)
        poses = np.array([pose.compose(Twist2D(*part).held(1.0)) for part in held.tolist()])
        return command if self._free(checker, poses, self._allowed[np.full(4, at)]) == 4 else None

    def _steered(
        self, sign: float, end: int, pose: Pose2D, velocity: Twist2D, parameters: FollowerParameters, period: float,
        speeds: tuple[float, float], top_turn: float,
    ) -> Twist2D:
        """Return the command on a part that leads forwards only, or backwards only, up to the pose of index `end`.

        Source: Kanayama et al., "A stable tracking control method for an autonomous mobile robot" (1990), equation 10.
        """
        p, at = parameters, self._at
        error = pose.relative_to(Pose2D(*self.poses[at].tolist()))
        left = float(np.abs(self._ahead[at:end]).sum()) - sign * error.x
        delay = period + p.stop_time_buffer
        wanted = sign * min(speeds[1], max(speeds[0], speed_to_stop_within(left, p.acc_lim_x, delay)))
        change = p.acc_lim_x * period
        speed = min(velocity.x + change, max(velocity.x - change, wanted))
        reach = self._reach
        near = max(at + 1, min(end, int(np.searchsorted(self.arcs, self.arcs[at] + reach))))
        curvature = float(self._turns[at:near].sum() / self._ahead[at:near].sum())
        turn = 0.0
        if speed * sign > 0.0:  # rolling the other way still, it would turn to the wrong side
            turn = speed * (curvature - error.y / reach ** 2) - abs(speed) * 2.0 * math.sin(error.theta) / reach
        if self._radius > 0.0:
            top_turn = min(top_turn, abs(speed) / self._radius)
        turn = min(top_turn, max(-top_turn, turn))
        most = p.acc_lim_theta * period
        return Twist2D(speed, 0.0, min(velocity.theta + most, max(velocity.theta - most, turn)))

    def _is_past(self, at: int, pose: Pose2D) -> bool:
        """Return whether the robot has reached the pose of index `at + 1`, or half of a turn on the spot to it."""
        if self._signs[at] == 0.0:
            left = angle_between(pose.theta, self.poses[at + 1, 2])
            return bool(math.copysign(1.0, self._turns[at]) * left <= 0.5 * abs(self._turns[at]))
        beyond = pose.relative_to(Pose2D(*self.poses[at + 1].tolist()))
        return bool(self._signs[at] * beyond.x >= 0.0)

    @property
    def goes_back(self) -> bool:
        """Whether any part is driven backwards."""
        return bool((self._signs < 0.0).any())

    @staticmethod
    def _free(checker: FootprintChecker, poses: np.ndarray, allowed: np.ndarray) -> int:
        """Return the number of poses before the first that overlaps more than `allowed`, (S, 2), as of depths_at."""
        for number in np.flatnonzero(checker.touches(poses)).tolist():
            deepest, total = checker.depths_at(Pose2D(*poses[number].tolist()))
            most = allowed[number, 0] + DEEPER
            if allowed[number, 0] < 0.0 or deepest < 0.0 or deepest > most or total > allowed[number, 1] + most:
                return int(number)
        return len(poses)
