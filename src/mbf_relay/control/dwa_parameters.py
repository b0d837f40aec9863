"""Parameters of the DWA controller: dwa_local_planner's names, defaults and older spellings, and a few of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Mapping, Tuple, Type, TypeVar

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.parameters import parameter, without_effect

D = TypeVar("D", bound="DwaParameters")


@dataclass(frozen=True)
class DwaParameters(FollowerParameters):
    """Parameters of DwaController, as dwa_local_planner/DWAPlannerROS reads them (ROS Noetic)."""

    max_vel_y: float = parameter(0.1, "highest velocity to the left; 0 if neither this nor min_vel_y is given", "m/s")
    min_vel_y: float = parameter(
        -0.1, "lowest velocity to the left; 0 if neither this nor a max_vel_y above 0 is given", "m/s")
    sim_time: float = parameter(1.7, "how far ahead trajectories are simulated", "s", above=0.0)
    sim_granularity: float = parameter(
        0.025, "distance between the points of a trajectory that are checked for collision", "m", above=0.0)
    angular_sim_granularity: float = parameter(
        0.1, "turn between the points of a trajectory that are checked for collision", "rad", above=0.0)
    use_dwa: bool = parameter(
        True, "sample velocities that can be reached within one control period; false samples all that can be reached "
        "within sim_time, and trajectories accelerate to them")
    vx_samples: int = parameter(
        3, "number of velocities tried along x; less than 2 count as 2, the lowest and the highest", minimum=0)
    vy_samples: int = parameter(
        10, "number of velocities tried along y; less than 2 count as 2, the lowest and the highest", minimum=0)
    vth_samples: int = parameter(
        20, "number of rotational velocities tried; less than 2 count as 2, the lowest and the highest", minimum=0)

    path_distance_bias: float = parameter(
        0.6, "weight of the distance from the path; higher keeps closer to it", minimum=0.0)
    goal_distance_bias: float = parameter(
        0.8, "weight of the distance left to the goal; higher drives faster", minimum=0.0)
    occdist_scale: float = parameter(
        0.01, "weight of the highest costmap cost along a trajectory; higher keeps farther from obstacles", minimum=0.0)
    twirling_scale: float = parameter(0.0, "weight of the rotational speed; higher turns less; 0 for none", minimum=0.0)
    prefer_forward_scale: float = parameter(
        0.5, "cost of driving backwards at full speed, as metres off the path; 0 for none", "m", minimum=0.0)
    steady_scale: float = parameter(
        0.01, "cost of changing the rotational velocity by 1 rad/s, as metres off the path; 0 for none", "m",
        minimum=0.0)
    counter_steering_scale: float = parameter(
        0.12, "cost of turning to the other side than before, as metres off the path, less in narrow places; 0 for "
        "none", "m", minimum=0.0)
    slow_scale: float = parameter(
        0.1, "cost of a velocity below both min_vel_trans and min_vel_theta, as metres off the path; 0 for none", "m",
        minimum=0.0)
    foresight_scale: float = parameter(
        2.0, "cost of meeting a moving obstacle at once, as metres off the path; falls to nothing at foresight_horizon "
        "(only with foresight)", "m", minimum=0.0)
    sum_scores: bool = parameter(False, "sum the costmap's costs along a trajectory instead of taking the highest")
    forward_point_distance: float = parameter(
        0.325, "distance of the scored forward point ahead of the robot's centre, which keeps the robot facing along "
        "the path", "m")
    cheat_factor: float = parameter(
        1.0, "nearer to the goal than forward_point_distance * sqrt(cheat_factor), the forward point need not be on "
        "the path", minimum=0.0)
    scaling_speed: float = parameter(0.25, "speed above which the footprint is enlarged", "m/s", minimum=0.0)
    max_scaling_factor: float = parameter(
        0.2, "how much the footprint is enlarged at max_vel_trans; 0.2 makes it 1.2 times as large", minimum=0.0)
    oscillation_reset_dist: float = parameter(
        0.05, "distance the robot must drive before it may reverse the direction of its motion again", "m", minimum=0.0)
    oscillation_reset_angle: float = parameter(
        0.2, "angle the robot must turn before it may reverse the direction of its motion again", "rad", minimum=0.0)

    heading_scale: float = parameter(
        0.0, "cost per radian between the heading and the direction of the farthest visible point of the path (only "
        "with `heading` among the critics)", "1/rad", minimum=0.0)
    heading_time: float = parameter(0.8, "time along a trajectory at which its heading is scored", "s", minimum=0.0)
    turn_to_path_angle: float = parameter(
        1.0, "angle to the path above which the robot first turns on the spot; above pi it never does", "rad",
        above=0.0)
    critics: Tuple[str, ...] = parameter(
        (
            "oscillation",
            "obstacle",
            "foresight",
            "goal_front",
            "alignment",
            "path",
            "goal",
            "twirling",
            "prefer_forward",
            "slow",
            "steady",
            "counter_steering",
        ),
        "critics in the order in which they are evaluated; package.module.Class adds one of your own")
    publish_traj_pc: bool = parameter(False, "publish the sampled trajectories on trajectory_cloud")
    publish_cost_grid_pc: bool = parameter(False, "publish the costs of the local costmap's cells on cost_cloud")
    odom_topic: str = parameter("", "topic of odometry, if the server's own odom_topic is not given; read at start")
    global_frame_id: str = without_effect("odom", "the clouds are in the costmap's frame")

    @classmethod
    def read(cls: Type[D], values: Mapping[str, Any]) -> Tuple[D, List[str]]:
        """Make one as FollowerParameters.read does, of a robot that only drives sideways where something says it can.

        The default of C++, 0.1 m/s either way, sends sideways velocities to wheels that cannot follow: they stand.
        """
        given = cls.known(values)
        if given.get("acc_lim_y") == 0.0 or not given.get("max_vel_y", 0.0) == given.get("min_vel_y", 0.0) == 0.0:
            return super().read(values)
        parameters, notes = super().read({**values, "max_vel_y": 0.0, "min_vel_y": 0.0})
        if "max_vel_y" not in given:
            notes = [*notes, "parameter max_vel_y is not given: 0 is used, for a robot that cannot drive sideways"]
        return parameters, notes
