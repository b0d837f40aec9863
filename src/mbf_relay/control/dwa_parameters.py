"""Parameters of the DWA controller: dwa_local_planner's names, defaults and older spellings, and a few of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Mapping, Tuple, Type, TypeVar

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.parameters import parameter

D = TypeVar("D", bound="DwaParameters")


@dataclass(frozen=True)
class DwaParameters(FollowerParameters):
    """Parameters of DwaController, as dwa_local_planner/DWAPlannerROS reads them (ROS Noetic)."""

    max_vel_y: float = parameter(
        0.1, "top velocity to the left; 0 where a file gives neither this nor min_vel_y", "m/s")
    min_vel_y: float = parameter(
        -0.1, "lowest velocity to the left; 0 where a file gives neither this nor max_vel_y above 0", "m/s")
    sim_time: float = parameter(1.7, "how far ahead trajectories reach", "s", above=0.0)
    sim_granularity: float = parameter(0.025, "distance between checked points of a trajectory", "m", above=0.0)
    angular_sim_granularity: float = parameter(0.1, "turn between checked points of a trajectory", "rad", above=0.0)
    use_dwa: bool = parameter(
        True, "sample velocities reached within one period; otherwise all reached within sim_time, with acceleration"
    )
    vx_samples: int = parameter(3, "samples along x; 0 counts as 1", minimum=0)
    vy_samples: int = parameter(10, "samples along y; 0 counts as 1", minimum=0)
    vth_samples: int = parameter(20, "samples of the turn; 0 counts as 1", minimum=0)

    path_distance_bias: float = parameter(0.6, "weight of the distance to the path", minimum=0.0)
    goal_distance_bias: float = parameter(0.8, "weight of the distance left to the goal", minimum=0.0)
    occdist_scale: float = parameter(0.01, "weight of the highest cost passed", minimum=0.0)
    twirling_scale: float = parameter(0.0, "weight of the rotational speed", minimum=0.0)
    prefer_forward_scale: float = parameter(
        0.5, "what driving backwards at full speed costs, as metres off the path", "m", minimum=0.0
    )
    steady_scale: float = parameter(
        0.01, "what a change of the turn by 1 rad/s costs, as metres off the path", "m", minimum=0.0
    )
    counter_steering_scale: float = parameter(
        0.12, "what turning to the other side than last costs, as metres off the path; less where it is narrow", "m",
        minimum=0.0,
    )
    slow_scale: float = parameter(
        0.1,
        "what a velocity below both min_vel_trans and min_vel_theta costs, as metres off the path",
        "m",
        minimum=0.0,
    )
    foresight_scale: float = parameter(
        2.0,
        "what meeting something that moves costs, as metres off the path: all of it now, nothing at foresight_horizon",
        "m",
        minimum=0.0,
    )
    sum_scores: bool = parameter(False, "sum the costs along a trajectory instead of taking the highest")
    forward_point_distance: float = parameter(
        0.325, "how far ahead of the robot its forward point lies, which is scored, too", "m"
    )
    cheat_factor: float = parameter(
        1.0,
        "the forward point is no longer held to the path nearer to the goal than forward_point_distance times its root",
        minimum=0.0,
    )
    scaling_speed: float = parameter(0.25, "speed above which the footprint grows", "m/s", minimum=0.0)
    max_scaling_factor: float = parameter(0.2, "growth of the footprint at max_vel_trans", minimum=0.0)
    oscillation_reset_dist: float = parameter(0.05, "distance that lifts the ban on turning back", "m", minimum=0.0)
    oscillation_reset_angle: float = parameter(0.2, "turn that lifts the ban on turning back", "rad", minimum=0.0)

    heading_scale: float = parameter(
        0.0, "what a radian off the farthest point of the path in sight costs, where `heading` is among the critics",
        "1/rad", minimum=0.0,
    )
    heading_time: float = parameter(0.8, "how far along a trajectory its heading is scored", "s", minimum=0.0)
    turn_to_path_angle: float = parameter(
        1.0, "heading error beyond which the robot turns on the spot before it drives; above pi never", "rad", above=0.0
    )
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
        "critics in the order they are asked; package.module.Class for one of your own",
    )
    publish_traj_pc: bool = parameter(False, "publish trajectory_cloud")
    publish_cost_grid_pc: bool = parameter(False, "publish cost_cloud")
    odom_topic: str = parameter(
        "", "topic of the robot's odometry, where the server's own odom_topic is not given; read at start")
    global_frame_id: str = parameter("odom", "read, and without effect: the clouds are in the costmap's frame")

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
            notes = [*notes, "parameter max_vel_y is not given: 0 is used, for wheels that only roll"]
        return parameters, notes
