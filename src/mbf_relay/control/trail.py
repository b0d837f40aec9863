"""The trail: where a robot has been of late, and the way back along it, which was free when it came."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.control.turning import turn_rate
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D, angle_between, normalize_angles

APART = 2.5  # checked steps between poses noted: half a cell, as exactly as obstacles are known
MOST = 256  # poses noted: more way than a local costmap shows
DEEPER = 0.5  # cells by which a mark may lie deeper than noted: what is seen anew is marked half a cell off
BESIDE = 0.5  # robot's widths along the trail within which one mark is passed
STEER = 0.3  # robot's widths in which an error across the way is steered out
ON_THE_SPOT = 0.12  # robot's widths: a turn round less than that is one on the spot


class Trail:
    """Notes poses, and how deep the footprint lay in marks there.

    A costmap has marks where a robot that passed them by a hair has been. It came in because what it touches already
    it may go on touching; once it touches nothing they would shut it in. It has been there, so they are not in its
    way, as long as they are what they were.
    """

    def __init__(self) -> None:
        self._poses = np.empty((0, 3))
        self._depths = np.empty((0, 2))
        self._frame: Optional[str] = None

    def note(self, pose: Pose2D, checker: FootprintChecker) -> None:
        """Note where the robot is; a loop it has driven is left out."""
        away = self._poses - pose
        distances = np.hypot(away[:, 0], away[:, 1])
        if len(away) and (checker.costmap.frame != self._frame or distances[-1] > checker.costmap.width):
            self.__init__()  # type: ignore[misc]  # set down elsewhere
            away, distances = away[:0], distances[:0]
        self._frame = checker.costmap.frame
        depths = checker.depths_at(pose)
        near = np.flatnonzero(distances < APART * checker.step)
        near = near[np.abs(normalize_angles(away[near, 2])) < APART * checker.turn_step]
        if len(near):
            first = int(near[0])
            self._poses, self._depths = self._poses[:first + 1], self._depths[:first + 1]
            self._depths[first] = np.maximum(self._depths[first], depths)
        else:
            self._poses = np.vstack((self._poses[1 - MOST:], pose))
            self._depths = np.vstack((self._depths[1 - MOST:], depths))

    def way_back(self, pose: Pose2D, checker: FootprintChecker) -> WayBack:
        """Return the way back from the pose noted last, where the robot is; where none was, there is none."""
        if not len(self._poses):
            return WayBack(np.array([pose]), np.full((1, 2), -1.0), checker.costmap.width)
        corners = np.vstack((pose, self._poses[-2::-1]))
        moves = np.diff(corners, axis=0)
        moves[:, 2] = normalize_angles(moves[:, 2])
        counts = np.ceil(np.maximum(
            np.hypot(moves[:, 0], moves[:, 1]) / (2.0 * checker.step), np.abs(moves[:, 2]) / (2.0 * checker.turn_step)))
        which = np.repeat(np.arange(len(moves)), counts.astype(np.int64))
        share = (np.arange(len(which)) - np.concatenate(([0.0], np.cumsum(counts)[:-1]))[which] + 1.0) / counts[which]
        poses = np.vstack((corners[:1], corners[which] + share[:, None] * moves[which]))
        return WayBack(poses, self._depths[::-1][np.append(0, which + 1)], checker.costmap.width)


class WayBack:
    """A way that leads through poses a robot has been at, the last one first.

    Args:
        poses: Shape (S, 3), in the costmap's frame; the first is the robot's.
        depths: Shape (S, 2): how deep (cells) the footprint lay in marks when it was there; see FootprintChecker.
        width: The robot's (m).

    Attributes:
        arcs: Shape (S,): way (m) of the robot's rim to each.
    """

    def __init__(self, poses: np.ndarray, depths: np.ndarray, width: float) -> None:
        self.poses, self._width = poses, width
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
        """Return how many of the poses left are free before the first that is not."""
        return self._free(checker, self.poses[self._at:], self._allowed[self._at:])

    def cut(self, last: int) -> None:
        """Let the way end at one of its poses."""
        self.poses, self.arcs, self._allowed = self.poses[:last + 1], self.arcs[:last + 1], self._allowed[:last + 1]

    def command(
        self, pose: Pose2D, velocity: Twist2D, checker: FootprintChecker, parameters: FollowerParameters,
        period: float, speeds: tuple[float, float], top_turn: float,
    ) -> Optional[Twist2D]:
        """Return the next velocity on the way, None at its end or where it is not free any more.

        Args:
            pose, velocity: The robot now.
            checker: The obstacles.
            parameters: Limits.
            period: Seconds until the next command.
            speeds: The slowest and the fastest (m/s) of the drive.
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
        """Return the command on a stretch that leads one way.

        Source: Kanayama et al., "A stable tracking control method for an autonomous mobile robot" (1990), equation 10.
        """
        p, at = parameters, self._at
        error = pose.relative_to(Pose2D(*self.poses[at].tolist()))
        left = float(np.abs(self._ahead[at:end]).sum()) - sign * error.x
        delay = period + p.stop_time_buffer
        wanted = sign * min(speeds[1], max(speeds[0], speed_to_stop_within(left, p.acc_lim_x, delay)))
        change = p.acc_lim_x * period
        speed = min(velocity.x + change, max(velocity.x - change, wanted))
        near = max(at + 1, min(end, int(np.searchsorted(self.arcs, self.arcs[at] + STEER * self._width))))
        curvature = float(self._turns[at:near].sum() / self._ahead[at:near].sum())
        reach = STEER * self._width
        turn = 0.0
        if speed * sign > 0.0:  # one that still rolls the other way would turn to the wrong side
            turn = speed * (curvature - error.y / reach ** 2) - abs(speed) * 2.0 * math.sin(error.theta) / reach
        turn = min(top_turn, max(-top_turn, turn))
        most = p.acc_lim_theta * period
        return Twist2D(speed, 0.0, min(velocity.theta + most, max(velocity.theta - most, turn)))

    def _is_past(self, at: int, pose: Pose2D) -> bool:
        """Return whether the robot has come at least as far as the pose after this one."""
        if self._signs[at] == 0.0:
            left = angle_between(pose.theta, self.poses[at + 1, 2])
            return bool(math.copysign(1.0, self._turns[at]) * left <= 0.5 * abs(self._turns[at]))
        beyond = pose.relative_to(Pose2D(*self.poses[at + 1].tolist()))
        return bool(self._signs[at] * beyond.x >= 0.0)

    @staticmethod
    def _free(checker: FootprintChecker, poses: np.ndarray, allowed: np.ndarray) -> int:
        """Return how many of the poses are free before one where more is entered than `allowed`, (S, 2)."""
        for number in np.flatnonzero(checker.touches(poses)).tolist():
            deepest, total = checker.depths_at(Pose2D(*poses[number].tolist()))
            most = allowed[number, 0] + DEEPER
            if allowed[number, 0] < 0.0 or deepest < 0.0 or deepest > most or total > allowed[number, 1] + most:
                return int(number)
        return len(poses)
