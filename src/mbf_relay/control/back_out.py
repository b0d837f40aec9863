"""Backing out: a short, slow drive backwards out of a place in which a robot can neither go on nor turn."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D, angle_between, normalize_angles

PATIENCE = 0.25  # s without a velocity before it begins
ASKEW = 0.5  # rad off the path's direction: one that faces along it and cannot go on has nothing to turn for
TRIES = 4  # without progress, before it is left to whoever sent the robot
SPEED, SLOWEST = 0.45, 0.15  # of the top speed

# in robot's widths
REACH = (0.45, 0.9, 1.5)  # the first try, the second, and all later ones without progress
LEAST = 0.13  # what must be free behind for a try
PROGRESS = 1.3  # how much nearer to the goal makes the next try a first one
AHEAD = 0.9  # where on the path the direction lies that it turns to
FAR = 4.5  # it brakes for nothing farther behind
HEADING_WORTH = 0.35  # lateral distance that a radian off the path's direction counts as
CURVATURES = np.array([0.0, 0.35, -0.35, 0.7, -0.7, 1.15, -1.15])  # of the arcs tried, one over a width


class BackOut:
    """Decides when to back out, along which arc, and when that is enough.

    It begins when driving has failed for a moment, takes the arc whose end lies nearest to the path in place and
    heading, and ends after a distance that grows from try to try until the robot has got nearer to the goal.
    """

    def __init__(self) -> None:
        self._failing_since: Optional[float] = None
        self._from: Optional[Pose2D] = None
        self._curvature = 0.0
        self._tries = 0
        self._best_left = math.inf

    @property
    def is_active(self) -> bool:
        """Return whether the robot is backing out."""
        return self._from is not None

    def reset(self) -> None:
        """Forget everything: the goal is a new one."""
        self.__init__()  # type: ignore[misc]

    def drove(self, path: LocalPath, width: float) -> None:
        """Note that a robot of this width (m) succeeded in driving."""
        self._failing_since = None
        if path.remaining < self._best_left - PROGRESS * width:
            self._best_left, self._tries = path.remaining, 0

    def failed(
        self, now: float, pose: Pose2D, path: LocalPath, checker: FootprintChecker, parameters: FollowerParameters
    ) -> None:
        """Note that driving failed, and begin to back out where it has for long enough and it is free behind."""
        if self._failing_since is None or now < self._failing_since:
            self._failing_since = now
        hopeless = self._tries >= TRIES or parameters.min_vel_x >= 0.0
        if hopeless or now - self._failing_since < PATIENCE:
            return
        width = checker.costmap.width
        ahead = path.point_at(min(path.robot_arc + AHEAD * width, float(path.arcs[-1])))
        heading = math.atan2(ahead[1] - pose.y, ahead[0] - pose.x)
        if abs(angle_between(pose.theta, heading)) < ASKEW:
            return
        self._best_left = min(self._best_left, path.remaining)
        reach = REACH[min(self._tries, len(REACH) - 1)] * width
        free, ends = _arcs(pose, checker, reach, CURVATURES / width)
        lateral = path.project(ends, -math.inf, math.inf)
        turns = np.abs(normalize_angles(np.arctan2(ahead[1] - ends[:, 1], ahead[0] - ends[:, 0]) - ends[:, 2]))
        costs = np.where(free >= LEAST * width, lateral[:, 0] + HEADING_WORTH * width * turns - 0.5 * free, np.inf)
        best = int(np.argmin(costs))
        if np.isfinite(costs[best]):
            self._from, self._curvature = pose, float(CURVATURES[best]) / width
            self._tries += 1

    def command(
        self, pose: Pose2D, velocity: Twist2D, checker: FootprintChecker, parameters: FollowerParameters, period: float
    ) -> Optional[Twist2D]:
        """Return the next velocity on the way back, None where it has come far enough or no farther."""
        if self._from is None:
            return None
        width = checker.costmap.width
        left = REACH[min(self._tries, len(REACH)) - 1] * width - pose.distance_to(self._from)
        free = 0.0
        if left > 0.0:
            free = float(_arcs(pose, checker, max(left, LEAST * width), np.array([self._curvature]))[0][0])
        if left <= 0.0 or free < 2.0 * checker.step:
            self._from, self._failing_since = None, None
            return None
        top = min(SPEED * parameters.max_vel_trans, -parameters.min_vel_x)
        delay = period + parameters.stop_time_buffer
        ahead = math.inf if free >= left else free  # where it is free throughout, it stops on whatever comes next
        slowest = SLOWEST * parameters.max_vel_trans
        wanted = -min(top, max(slowest, speed_to_stop_within(min(ahead, FAR * width), parameters.acc_lim_x, delay)))
        change = parameters.acc_lim_x * period
        speed = min(velocity.x + change, max(velocity.x - change, wanted))
        most = parameters.acc_lim_theta * period
        wanted_turn = -min(0.0, speed) * self._curvature  # one that still rolls forward would turn to the wrong side
        turn = min(velocity.theta + most, max(velocity.theta - most, wanted_turn))
        return Twist2D(speed, 0.0, min(parameters.max_vel_theta, max(-parameters.max_vel_theta, turn)))


def _arcs(
    pose: Pose2D, checker: FootprintChecker, length: float, curvatures: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far (m) each arc backwards is free, shape (N,), and the pose where that ends, shape (N, 3)."""
    most = math.ceil(length / checker.step) + 1
    targets = np.column_stack((np.full(len(curvatures), -1.0), np.zeros(len(curvatures)), -curvatures))
    poses, counts = np.empty((len(curvatures), most, 3)), np.empty(len(curvatures), np.int64)
    trajectory_kernels.simulate(
        np.array(pose, dtype=float),
        np.full(3, np.nan),
        np.ones(3),
        targets,
        np.full(len(curvatures), length),
        checker.step,
        math.inf,
        poses,
        counts,
        np.empty(len(curvatures)),
    )
    way = checker.first_contacts(poses, counts, np.ones(len(curvatures)), checker.contacts_at(pose))
    ends = poses[np.arange(len(poses)), np.maximum(way.steps, 1) - 1]
    return length * way.steps / counts, ends
