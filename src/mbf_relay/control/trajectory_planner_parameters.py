"""Parameters of base_local_planner's TrajectoryPlannerROS, move_base's default local planner."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Mapping, Tuple, Type, TypeVar

from mbf_relay.control.follower_parameters import check_acceleration, stuck_timeout_parameter
from mbf_relay.parameters import ParameterSet, parameter, without_effect

T = TypeVar("T", bound="TrajectoryPlannerParameters")

DYNAMIC = (
    "acc_lim_x",
    "acc_lim_y",
    "acc_lim_theta",
    "max_vel_x",
    "min_vel_x",
    "max_vel_theta",
    "min_vel_theta",
    "min_in_place_vel_theta",
    "sim_time",
    "sim_granularity",
    "angular_sim_granularity",
    "path_distance_bias",
    "goal_distance_bias",
    "occdist_scale",
    "oscillation_reset_dist",
    "escape_reset_dist",
    "escape_reset_theta",
    "vx_samples",
    "vtheta_samples",
    "heading_lookahead",
    "holonomic_robot",
    "escape_vel",
    "dwa",
    "heading_scoring",
    "heading_scoring_timestep",
    "simple_attractor",
    "y_vels",
)
"""What can be changed at run time, as in base_local_planner (ROS Noetic)."""


@dataclass(frozen=True)
class TrajectoryPlannerParameters(ParameterSet):
    """Parameters of TrajectoryPlanner, as base_local_planner/TrajectoryPlannerROS reads them (ROS Noetic)."""

    acc_lim_x: float = parameter(2.5, "acceleration limit along x", "m/s^2", 0.0, 20.0, aliases=("acc_limit_x",))
    acc_lim_y: float = parameter(2.5, "acceleration limit along y", "m/s^2", 0.0, 20.0, aliases=("acc_limit_y",))
    acc_lim_theta: float = parameter(
        3.2, "rotational acceleration limit", "rad/s^2", 0.0, 20.0, aliases=("acc_lim_th", "acc_limit_th"))
    max_vel_x: float = parameter(0.55, "highest forward velocity", "m/s", 0.0, 20.0)
    min_vel_x: float = parameter(0.0, "lowest forward velocity commanded", "m/s", 0.0, 20.0)
    max_vel_theta: float = parameter(
        1.0, "highest rotational velocity to the left", "rad/s", 0.0, 20.0,
        aliases=("max_rotational_vel", "max_vel_th"))
    min_vel_theta: float = parameter(
        -1.0, "highest rotational velocity to the right, below 0; the smaller of both magnitudes limits both sides",
        "rad/s", -20.0, 0.0, aliases=("min_vel_th",))
    min_in_place_vel_theta: float = parameter(
        0.4, "lowest rotational speed of a turn on the spot", "rad/s", 0.0, 20.0,
        aliases=("min_in_place_rotational_vel",))
    sim_time: float = parameter(1.7, "how far ahead trajectories are simulated", "s", above=0.0, maximum=10.0)
    sim_granularity: float = parameter(
        0.025, "distance between the points of a trajectory that are checked for collision", "m", above=0.0,
        maximum=5.0)
    angular_sim_granularity: float = parameter(
        0.025, "turn between the points of a trajectory that are checked for collision", "rad", above=0.0,
        maximum=math.pi / 2.0)
    path_distance_bias: float = parameter(
        0.6, "weight of the distance from the path, per cell, or per metre with meter_scoring", "", 0.0, 5.0,
        aliases=("pdist_scale",))
    goal_distance_bias: float = parameter(
        0.8, "weight of the distance left to the goal, per cell, or per metre with meter_scoring", "", 0.0, 5.0,
        aliases=("gdist_scale",))
    occdist_scale: float = parameter(
        0.01, "weight of the highest costmap cost along a trajectory; with meter_scoring it is multiplied by the "
        "resolution", "", 0.0, 5.0)
    meter_scoring: bool = parameter(
        False, "path_distance_bias and goal_distance_bias are per metre instead of per cell")
    oscillation_reset_dist: float = parameter(
        0.05, "distance the robot must drive before it may reverse the direction of its motion again", "m", 0.0, 5.0)
    escape_reset_dist: float = without_effect(0.1, "backing out ends once the robot can go on", "m", 0.0, 5.0)
    escape_reset_theta: float = without_effect(
        math.pi / 2.0, "backing out ends once the robot can go on", "rad", 0.0, 5.0)
    escape_vel: float = parameter(
        -0.1, "velocity of backing out, below 0, limited to 0.45 of the top speed; 0 or above never backs out", "m/s",
        -2.0, 2.0, aliases=("backup_vel",))
    vx_samples: int = parameter(20, "number of velocities tried along x", "", 1, 300)
    vtheta_samples: int = parameter(20, "number of rotational velocities tried", "", 1, 300)
    holonomic_robot: bool = parameter(True, "the robot can drive sideways, at the velocities in y_vels")
    y_vels: str = parameter(
        "-0.3,-0.1,0.1,-0.3", "sideways velocities, separated by commas; the largest magnitude is the limit", "m/s")
    dwa: bool = parameter(
        False, "sample velocities that can be reached within one control period; false samples all that can be reached "
        "within sim_time, and trajectories accelerate to them")
    heading_lookahead: float = parameter(
        0.325, "distance of the scored forward point ahead of the robot's centre", "m", 0.0, 5.0)
    heading_scoring: bool = parameter(False, "also score the heading towards the farthest visible point of the path")
    heading_scoring_timestep: float = parameter(
        0.1, "time along a trajectory at which its heading is scored", "s", 0.0, 1.0)
    simple_attractor: bool = without_effect(False, "the goal is always approached along the path")

    xy_goal_tolerance: float = parameter(
        0.1, "distance to the goal at which its position counts as reached", "m", above=0.0)
    yaw_goal_tolerance: float = parameter(
        0.05, "angle to the goal's heading at which it counts as reached", "rad", above=0.0)
    latch_xy_goal_tolerance: bool = parameter(
        False, "once within xy_goal_tolerance, only turn to the goal's heading until a new goal comes, even if the "
        "robot leaves it")
    stop_time_buffer: float = parameter(
        0.2, "a velocity is chosen only if the robot can keep it this long and then brake without a collision", "s",
        minimum=0.0)
    stuck_timeout: float = stuck_timeout_parameter()
    publish_cost_grid_pc: bool = parameter(
        False, "publish the costs of the local costmap's cells on cost_cloud", aliases=("publish_cost_grid",))
    prune_plan: bool = without_effect(True, "the path is always followed from its nearest point")
    world_model: str = without_effect("costmap", "obstacles are the local costmap's")
    controller_frequency: float = without_effect(20.0, "the server's controller_frequency is the rate", "Hz")
    global_frame_id: str = without_effect("odom", "the cloud is in the costmap's frame")

    @classmethod
    def read(cls: Type[T], values: Mapping[str, Any]) -> Tuple[T, List[str]]:
        """Make one as ParameterSet.read does, of a robot that cannot drive sideways where nothing says that it can.

        The default of C++, true, sends sideways velocities to wheels that cannot follow. Of y_vels that are a list, as
        the first tutorials' files have them, C++ takes nothing, and its default instead.
        """
        given, told = dict(values), []
        if isinstance(given.get("y_vels"), (list, tuple, int, float)) and not isinstance(given["y_vels"], bool):
            given["y_vels"] = str(given["y_vels"]).strip("[()]").replace(" ", "")
            told.append(f"parameter y_vels is {values['y_vels']!r} and no text: '{given['y_vels']}' is used")
        if "holonomic_robot" not in given:
            given["holonomic_robot"] = False
            told.append("parameter holonomic_robot is not given: false is used, for a robot that cannot drive sideways")
        parameters, notes = super().read(given)
        return parameters, notes + told

    def sideways(self) -> float:
        """Return the top speed (m/s) sideways.

        Raises:
            ValueError: y_vels holds something else than numbers.
        """
        if not self.holonomic_robot or self.acc_lim_y == 0.0:
            return 0.0
        texts = self.y_vels.replace("[", " ").replace("]", " ").replace(",", " ").split()
        try:
            return max((abs(float(text)) for text in texts), default=0.0)
        except ValueError:
            raise ValueError(f"parameter y_vels is {self.y_vels!r}; it must be numbers separated by commas") from None

    def turning(self) -> float:
        """Return the top speed (rad/s) of a turn to either side; a limit of 0 is none."""
        return min((abs(turn) for turn in (self.max_vel_theta, self.min_vel_theta) if turn != 0.0), default=0.0)

    def check(self) -> None:
        """Refuse y_vels that are no numbers, and a motion that has a speed and no acceleration."""
        for acceleration, fastest in (
            ("acc_lim_x", max(self.max_vel_x, -self.escape_vel)), ("acc_lim_y", self.sideways()),
            ("acc_lim_theta", self.turning()),
        ):
            check_acceleration(acceleration, getattr(self, acceleration), fastest)
