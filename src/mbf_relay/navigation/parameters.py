"""Parameters of the navigation server, by Move Base Flex's names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Iterable, Optional, Tuple

from mbf_relay.parameters import ParameterSet, parameter

USUAL_WAIT = 3.0
"""Seconds that Move Base Flex waits for a transform where tf_timeout is not given."""
USUAL_AGE = 1.0
"""Seconds: the oldest pose that Move Base Flex drives on, by its tf_timeout."""


@dataclass(frozen=True)
class NavigatorParameters(ParameterSet):
    """Rates, patience and retries, and what counts as arrived, stuck and oscillating."""

    planner_frequency: float = parameter(0.0, "Rate of replanning while driving; 0 for none", "Hz", 0.0, 100.0)
    planner_patience: float = parameter(
        5.0, "Time to wait for a path, before recovery and after it together; 0 for ever", "s", 0.0, 100.0
    )
    planner_max_retries: int = parameter(-1, "Times a failed plan is tried again; -1 until patience ends", "", -1, 1000)
    controller_frequency: float = parameter(20.0, "Rate of the control loop", "Hz", 0.1, 100.0)
    controller_patience: float = parameter(
        5.0, "Time to wait for a velocity before giving up; 0 for ever", "s", 0.0, 100.0
    )
    controller_max_retries: int = parameter(
        -1, "Times a failed cycle is tried again; -1 until patience ends", "", -1, 1000
    )
    recovery_enabled: bool = parameter(True, "Whether move_base runs recovery behaviours")
    recovery_patience: float = parameter(15.0, "Time a recovery behaviour may take; 0 for ever", "s", 0.0, 100.0)
    oscillation_timeout: float = parameter(
        0.0, "Time without progress that counts as oscillating; 0 for none", "s", 0.0, 60.0
    )
    oscillation_distance: float = parameter(0.5, "Distance that counts as progress", "m", 0.0, 10.0)
    oscillation_angle: float = parameter(3.14, "Turn that counts as progress", "rad", 0.0, 6.28)
    shutdown_costmaps: bool = parameter(False, "Whether costmaps rest while nothing is asked of them")
    shutdown_costmaps_delay: float = parameter(1.0, "Time after the last goal before costmaps rest", "s", 0.0, 60.0)

    global_frame: str = parameter("map", "Frame of paths and of reported poses", is_frame=True)
    map_frame: str = parameter("map", "Older name of global_frame, read where that is not given", is_frame=True)
    robot_frame: str = parameter("base_link", "Frame of the robot's base", is_frame=True)
    odom_topic: str = parameter(
        "odom", "Topic of odometry; where given, before any that a controller's parameters name; empty to do without")
    tf_timeout: Optional[float] = parameter(
        None, "How long to wait for a transform, standing; if not given, planner_patience or controller_patience",
        "s", 0.0)
    pose_timeout: Optional[float] = parameter(
        None, "Age beyond which a pose is not driven on; 1, or a costmap's transform_tolerance if longer, by default",
        "s", above=0.0)
    odom_timeout: float = parameter(1.0, "Age beyond which odometry is not driven on", "s", above=0.0)
    force_stop_at_goal: bool = parameter(False, "read, and without effect: driving always ends with a zero velocity")
    force_stop_on_retry: bool = parameter(True, "Stop while a failed cycle is tried again; else slow down")
    force_stop_on_cancel: bool = parameter(
        False, "Stop also where another goal takes over at once; a cancel always stops"
    )
    mbf_tolerance_check: bool = parameter(False, "Whether the server, besides the controller, judges arrival")
    dist_tolerance: float = parameter(0.1, "Distance to the goal that is arrival for the server", "m", 0.0)
    angle_tolerance: float = parameter(math.pi / 18.0, "Angle to the goal that is arrival for the server", "rad", 0.0)
    cmd_vel_ignored_tolerance: float = parameter(
        5.0, "Time a robot may stand still against commands before it counts as stuck; 0 or less for ever", "s"
    )
    client_timeout: float = parameter(
        0.0,
        "Time after which goals of a client that disconnected end; 0 for never; a relay's end within 1 s in any case",
        "s",
        0.0,
    )
    clear_on_shutdown: bool = parameter(False, "Whether resting costmaps forget obstacles")

    def oldest_pose(self, costmaps: Iterable[Any]) -> float:
        """Return the age (s) beyond which a pose is not driven on: move_base drives on as old ones as its costmaps do.
        """
        if self.pose_timeout is not None:
            return self.pose_timeout
        return max([USUAL_AGE, *(float(costmap.parameters.transform_tolerance) for costmap in costmaps)])

    @property
    def planning_tf_timeout(self) -> float:
        """How long (s) planning waits for a transform: no shorter than for a path, nor than Move Base Flex does."""
        return max(USUAL_WAIT, self.planner_patience) if self.tf_timeout is None else self.tf_timeout

    @property
    def control_tf_timeout(self) -> Tuple[float, str]:
        """How long (s) control waits for a transform, standing, and by which parameter.

        move_base has no other patience for that than for a velocity.
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
