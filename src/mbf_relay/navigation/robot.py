"""The port through which navigation reaches a robot: tf and topics under ROS, the simulation itself in lockstep."""

from __future__ import annotations

import abc
from typing import Optional

from mbf_relay.control.command_delay import CommandDelay
from mbf_relay.control.steering import Steering
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.outcomes import StaleDataError

OVERRUN_PERIODS = 3.0
"""Control periods a velocity stays in force without a new one; a plugin that thinks longer lets the robot stand."""
TOO_OLD = 1.0
"""Seconds after which what a plugin saw of the robot's surroundings is too old for a velocity thought of by it."""


class Robot(abc.ABC):
    """Where the robot is, how it moves, and how to move it.

    Attributes:
        commanded: The velocity sent last; None where that is not known.
        steering: Set where its wheels take a steering angle for a rate; velocities are rates here all the same.
        paused: Whether drives and recoveries are to stand by, with their goals, until it is False again; may be set
            from any thread.
        delay: How late it does what it is told.
        waits_for: Why a drive stands and does not ask its controller, as without a pose; empty where it does.
    """

    commanded: Optional[Twist2D] = None
    steering: Optional[Steering] = None
    paused: bool = False
    waits_for: str = ""

    def __init__(self) -> None:
        self.delay = CommandDelay()

    @abc.abstractmethod
    def pose_in(self, frame: str) -> Pose2D:
        """Return the newest pose of the robot's base in `frame`.

        Raises:
            TransformError: The frames are not connected or the newest relation is too old.
        """

    @abc.abstractmethod
    def transform(self, target_frame: str, source_frame: str) -> Pose2D:
        """Return the newest transform that takes poses in `source_frame` to `target_frame`.

        Raises:
            TransformError: As for `pose_in`.
        """

    @abc.abstractmethod
    def velocity(self) -> Twist2D:
        """Return the newest velocity from odometry, body frame.

        Raises:
            StaleDataError: There is none, or it is too old.
        """

    @abc.abstractmethod
    def command(self, velocity: Twist2D) -> None:
        """Send a velocity to the wheels; finite, within limits. `delay` is told of what really goes out."""

    def pose_ahead(self, frame: str) -> float:
        """Return by how much (s) the newest pose in `frame` is newer than the newest velocity; below 0 for older."""
        return 0.0

    def caught_up(self, pose: Pose2D, frame: str) -> Pose2D:
        """Return where a robot is now whose newest pose in `frame` may be older than odometry, as that tells since."""
        return self.delay.caught_up(pose, -self.pose_ahead(frame))

    def expected_in(self, pose: Pose2D, costmap: CostGrid) -> Pose2D:
        """Return where a robot at `pose` now will be when it does what it is told next, both in a costmap's frame.

        It is carried no farther than to what it meets on its way, or it would take that for passed.
        """
        ahead = max(0.0, self.pose_ahead(costmap.frame))
        if self.delay.seconds <= ahead:
            return pose
        checker = FootprintChecker(costmap, unknown_touches=False)
        way = self.delay.way(pose, checker.longest_step, checker.longest_turn, ahead)
        return Pose2D(*map(float, way[min(checker.free_steps(way, pose), len(way) - 1)]))

    def note_motion(self, now: float, velocity: Twist2D) -> None:
        """Learn how late it does what it is told, from its velocity `now` (s) as odometry tells it."""
        self.delay.note(now, velocity)

    @property
    def unheard(self) -> str:
        """Why no velocity reaches the wheels, empty where that is not known."""
        return ""

    @property
    def held_back(self) -> str:
        """Who passes velocities on slower than they were sent, or not at all, and why; empty where nobody says so."""
        return ""

    @property
    def knows_its_motion(self) -> bool:
        """Whether odometry tells how the robot moves."""
        try:
            self.velocity()
        except StaleDataError:
            return False
        return True
