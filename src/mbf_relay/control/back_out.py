"""Backing out: a short, slow drive backwards out of a place in which a robot can neither go on nor turn."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.obstacle_view import ObstacleView
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.geometry import Pose2D, Twist2D, angle_between, normalize_angles

SPEED = 0.1  # m/s
SLOWEST = 0.03  # m/s
PATIENCE = 0.25  # s without a velocity before it begins
REACH = (0.1, 0.2, 0.35)  # m: the first try, the second, and all later ones without progress
ASKEW = 0.5  # rad off the path's direction: one that faces along it and cannot go on has nothing to turn for
TRIES = 4  # without progress, before it is left to whoever sent the robot
LEAST = 0.03  # m that must be free behind for a try
PROGRESS = 0.3  # m nearer to the goal that make the next try a first one
CURVATURES = np.array([0.0, 1.5, -1.5, 3.0, -3.0, 5.0, -5.0])  # 1/m
STEP = 0.01  # m between checked poses
HEADING_WORTH = 0.08  # m of lateral distance that a radian off the path's direction counts as


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
        """Tell whether the robot is backing out."""
        return self._from is not None

    def reset(self) -> None:
        """Forget everything: the goal is a new one."""
        self.__init__()

    def drove(self, path: LocalPath) -> None:
        """Note that driving succeeded."""
        self._failing_since = None
        if path.remaining < self._best_left - PROGRESS:
            self._best_left, self._tries = path.remaining, 0

    def failed(self, now: float, pose: Pose2D, path: LocalPath, view: ObstacleView, parameters: FollowerParameters) -> None:
        """Note that driving failed, and begin to back out where it has for long enough and there is room behind."""
        if self._failing_since is None or now < self._failing_since:
            self._failing_since = now
        hopeless = self._tries >= TRIES or parameters.min_vel_x >= 0.0
        if hopeless or now - self._failing_since < PATIENCE:
            return
        ahead = path.point_at(min(path.robot_arc + 0.2, float(path.arcs[-1])))
        heading = math.atan2(ahead[1] - pose.y, ahead[0] - pose.x)
        if abs(angle_between(pose.theta, heading)) < ASKEW:
            return
        self._best_left = min(self._best_left, path.remaining)
        reach = REACH[min(self._tries, len(REACH) - 1)]
        free, ends = _arcs(pose, view, reach)
        lateral = path.project(ends, -math.inf, math.inf)
        turns = np.abs(normalize_angles(np.arctan2(ahead[1] - ends[:, 1], ahead[0] - ends[:, 0]) - ends[:, 2]))
        costs = np.where(free >= LEAST, lateral[:, 0] + HEADING_WORTH * turns - 0.5 * free, np.inf)
        best = int(np.argmin(costs))
        if np.isfinite(costs[best]):
            self._from, self._curvature = pose, float(CURVATURES[best])
            self._tries += 1

    def command(
        self, pose: Pose2D, velocity: Twist2D, view: ObstacleView, parameters: FollowerParameters, period: float
    ) -> Optional[Twist2D]:
        """Return the next velocity on the way back, None where it has come far enough or no farther."""
        if self._from is None:
            return None
        left = REACH[min(self._tries, len(REACH)) - 1] - pose.distance_to(self._from)
        free = float(_arcs(pose, view, max(left, LEAST), np.array([self._curvature]))[0][0]) if left > 0.0 else 0.0
        if left <= 0.0 or free < 2.0 * STEP:
            self._from, self._failing_since = None, None
            return None
        top = min(SPEED, -parameters.min_vel_x, parameters.max_vel_trans)
        delay = period + parameters.stop_time_buffer
        room = math.inf if free >= left else free  # where it is free throughout, it stops on whatever comes next
        wanted = -min(top, max(SLOWEST, speed_to_stop_within(min(room, 1.0), parameters.acc_lim_x, delay)))
        change = parameters.acc_lim_x * period
        speed = min(velocity.x + change, max(velocity.x - change, wanted))
        most = parameters.acc_lim_theta * period
        turn = min(velocity.theta + most, max(velocity.theta - most, -speed * self._curvature))
        return Twist2D(speed, 0.0, min(parameters.max_vel_theta, max(-parameters.max_vel_theta, turn)))


def _arcs(
    pose: Pose2D, view: ObstacleView, length: float, curvatures: np.ndarray = CURVATURES
) -> "tuple[np.ndarray, np.ndarray]":
    """Return how far (m) each arc backwards is free, shape (N,), and the pose where that ends, shape (N, 3)."""
    most = math.ceil(length / STEP) + 1
    targets = np.column_stack((np.full(len(curvatures), -1.0), np.zeros(len(curvatures)), -curvatures))
    poses, counts = np.empty((len(curvatures), most, 3)), np.empty(len(curvatures), np.int64)
    trajectory_kernels.simulate(
        np.array(pose, dtype=float), np.full(3, np.nan), np.ones(3), targets, np.full(len(curvatures), length), STEP,
        math.inf, poses, counts, np.empty(len(curvatures)),
    )
    way = view.first_contacts(poses, counts, np.ones(len(curvatures)), view.contacts_at(pose))
    ends = poses[np.arange(len(poses)), np.maximum(way.steps, 1) - 1]
    return length * way.steps / counts, ends
