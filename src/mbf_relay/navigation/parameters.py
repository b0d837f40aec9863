"""Parameters of the navigation server, by Move Base Flex's names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Iterable, Optional, Tuple

from mbf_relay.parameters import ParameterSet, parameter, without_effect

USUAL_WAIT = 3.0
"""Default of Move Base Flex's tf_timeout (s)."""
USUAL_AGE = 1.0
"""Largest age (s) of the robot's pose where pose_timeout is not given and no transform_tolerance is larger."""


@dataclass(frozen=True)
class NavigatorParameters(ParameterSet):
    """Parameters of the navigation server, by Move Base Flex's names."""

    planner_frequency: float = parameter(0.0, "rate of replanning while driving; 0 to plan only once", "Hz", 0.0, 100.0)
    planner_patience: float = parameter(
        5.0, "time to try for a path before giving up, where planning before and after recovery counts together; 0 for "
        "no limit", "s", 0.0, 100.0)
    planner_max_retries: int = parameter(
        -1, "how often failed planning is retried; -1 until planner_patience ends", "", -1, 1000)
    controller_frequency: float = parameter(20.0, "rate of the control loop", "Hz", 0.1, 100.0)
    controller_patience: float = parameter(
        5.0, "time without a valid velocity before giving up; 0 for no limit", "s", 0.0, 100.0)
    controller_max_retries: int = parameter(
        -1, "how often a failed control cycle is retried; -1 until controller_patience ends", "", -1, 1000)
    recovery_enabled: bool = parameter(True, "run recovery behaviours in the action move_base")
    recovery_patience: float = parameter(
        15.0, "longest time for one recovery behaviour; 0 for no limit", "s", 0.0, 100.0)
    oscillation_timeout: float = parameter(
        0.0, "time without progress (see oscillation_distance) that counts as oscillating; 0 to switch the check off",
        "s", 0.0, 60.0)
    oscillation_distance: float = parameter(0.5, "distance that counts as progress", "m", 0.0, 10.0)
    oscillation_angle: float = parameter(3.14, "turn that counts as progress", "rad", 0.0, 6.28)
    shutdown_costmaps: bool = parameter(False, "stop updating the costmaps while there is no goal")
    shutdown_costmaps_delay: float = parameter(1.0, "time after the last goal before the costmaps stop", "s", 0.0, 60.0)

    global_frame: str = parameter("map", "frame of paths and of reported poses", is_frame=True)
    map_frame: str = parameter("map", "older name of global_frame, read if that is not given", is_frame=True)
    robot_frame: str = parameter("base_link", "frame of the robot's base", is_frame=True)
    odom_topic: str = parameter(
        "odom", "topic of odometry; if given, it is used instead of one in a controller's parameters; empty to do "
        "without odometry")
    tf_timeout: Optional[float] = parameter(
        None, "how long to wait, standing, for a transform; if not given, planner_patience (at least 3 s) or "
        "controller_patience", "s", 0.0)
    pose_timeout: Optional[float] = parameter(
        None, "age of the robot's pose above which it stops; if not given, 1 or the longest transform_tolerance of the "
        "costmaps", "s", above=0.0)
    odom_timeout: float = parameter(1.0, "age of odometry above which the robot stops", "s", above=0.0)
    force_stop_at_goal: bool = without_effect(False, "a zero velocity always ends the drive")
    force_stop_on_retry: bool = parameter(True, "stop at once while a failed cycle is retried; false slows down")
    force_stop_on_cancel: bool = parameter(
        False, "stop also when another goal follows at once; a cancel without one always stops")
    mbf_tolerance_check: bool = parameter(False, "the server checks arrival too, by dist_tolerance and angle_tolerance")
    dist_tolerance: float = parameter(
        0.1, "distance to the goal that counts as arrived, with mbf_tolerance_check", "m", 0.0)
    angle_tolerance: float = parameter(
        math.pi / 18.0, "angle to the goal that counts as arrived, with mbf_tolerance_check", "rad", 0.0)
    cmd_vel_ignored_tolerance: float = parameter(
        5.0, "how long the robot may stand still against the commands before it counts as stuck; 0 or below for no "
        "limit", "s")
    client_timeout: float = parameter(
        0.0, "time after a client disconnects at which its goals are ended; 0 for never; goals of a relay end within 1 "
        "s in any case", "s", 0.0)
    clear_on_shutdown: bool = parameter(False, "clear obstacles when the costmaps stop (see shutdown_costmaps)")

    def oldest_pose(self, costmaps: Iterable[Any]) -> float:
        """Return the age (s) above which the robot's pose is too old to drive; as in move_base, at least the costmaps'.
        """
        if self.pose_timeout is not None:
            return self.pose_timeout
        return max([USUAL_AGE, *(float(costmap.parameters.transform_tolerance) for costmap in costmaps)])

    def ends_a_drive(self, refused: int) -> bool:
        """Return whether that many refused cycles in a row exceed controller_patience or controller_max_retries."""
        patience, retries = self.controller_patience, self.controller_max_retries
        return 0.0 < patience * self.controller_frequency <= refused or 0 <= retries < refused

    @property
    def planning_tf_timeout(self) -> float:
        """How long (s) planning waits for a transform."""
        return max(USUAL_WAIT, self.planner_patience) if self.tf_timeout is None else self.tf_timeout

    @property
    def control_tf_timeout(self) -> Tuple[float, str]:
        """How long (s) a drive waits, stopped, for a transform, and the name of the parameter that says so.

        As in move_base, that is controller_patience where tf_timeout is not given.
        """
        if self.tf_timeout is not None:
            return self.tf_timeout, "tf_timeout"
        return self.controller_patience or math.inf, "controller_patience"


DYNAMIC = (
    "planner_frequency", "planner_patience", "planner_max_retries", "controller_frequency", "controller_patience",
    "controller_max_retries", "recovery_enabled", "recovery_patience", "oscillation_timeout", "oscillation_distance",
    "oscillation_angle", "shutdown_costmaps", "shutdown_costmaps_delay",
)
"""The parameters that can be changed at run time."""
