"""Navigation's interface to a robot: implemented by tf and topics under ROS, by the simulation in lockstep."""

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
"""Number of control periods after which the robot is stopped while a plugin still computes the next velocity."""
TOO_OLD = 1.0
"""Computing time (s) above which a velocity is not sent, since the sensor data it was computed from is too old."""


class Robot(abc.ABC):
    """Pose and velocity of a robot, and commands to it.

    Attributes:
        commanded: The last command (body frame; m/s, rad/s); None where not known.
        steering: Conversion for a base whose cmd_vel has a steering angle for angular.z; None for a turn rate, which
            all velocities here have.
        paused: Whether drives and recoveries stop the robot and keep their goals until this is False again; may be set
            from any thread.
        delay: Estimate of the delay from a command to the robot's motion.
        waits_for: Why a drive has stopped the robot and does not call its controller; empty where it does.
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
            TransformError: The frames are not connected, or the newest transform is too old.
        """

    @abc.abstractmethod
    def transform(self, target_frame: str, source_frame: str) -> Pose2D:
        """Return the newest transform that takes poses in `source_frame` to `target_frame`.

        Raises:
            TransformError: As for `pose_in`.
        """

    @abc.abstractmethod
    def velocity(self) -> Twist2D:
        """Return the newest velocity from odometry (body frame; m/s, rad/s).

        Raises:
            StaleDataError: There is none, or it is too old.
        """

    @abc.abstractmethod
    def command(self, velocity: Twist2D) -> None:
        """Send a finite velocity to the robot, and tell `delay` what was really sent."""

    def pose_ahead(self, frame: str) -> float:
        """Return by how much (s) the newest pose in `frame` is newer than the newest velocity; negative for older."""
        return 0.0

    def caught_up(self, pose: Pose2D, frame: str) -> Pose2D:
        """Return the newest `pose` in `frame`, extrapolated to odometry's time where it is older."""
        return self.delay.caught_up(pose, -self.pose_ahead(frame))

    def expected_in(self, pose: Pose2D, costmap: CostGrid) -> Pose2D:
        """Return the predicted pose at which the next command takes effect, for a robot at `pose` now.

        Both are in the costmap's frame. The prediction ends at the first obstacle on the way, or the robot would seem
        to be beyond it.
        """
        ahead = max(0.0, self.pose_ahead(costmap.frame))
        if self.delay.seconds <= ahead:
            return pose
        checker = FootprintChecker(costmap, unknown_touches=False)
        way = self.delay.way(pose, checker.longest_step, checker.longest_turn, ahead)
        return Pose2D(*map(float, way[min(checker.free_steps(way, pose), len(way) - 1)]))

    def note_motion(self, now: float, velocity: Twist2D) -> None:
        """Update the estimate of the delay with odometry's velocity at `now` (s)."""
        self.delay.note(now, velocity)

    @property
    def unheard(self) -> str:
        """Why commands do not reach the robot, as without a subscriber; empty where nothing is known of it."""
        return ""

    @property
    def held_back(self) -> str:
        """Which node reduces or blocks commands, such as velocity_guard, and why; empty where none does."""
        return ""

    def explained(self, standing: str) -> str:
        """Return a message that it stands against its commands, with the reason where one is known; empty as it is."""
        why = standing and (self.unheard or self.held_back)
        return f"{why}: {standing}" if why else standing

    @property
    def knows_its_motion(self) -> bool:
        """Whether odometry is there and valid."""
        try:
            self.velocity()
        except StaleDataError:
            return False
        return True
