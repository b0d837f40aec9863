"""Controllers that replace local planners of other packages, using their limits and tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Dict, List, Mapping, Tuple, Type

from mbf_relay.control.dwa import DwaController
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.follower_parameters import stuck_timeout_parameter
from mbf_relay.control.mppi.controller import MppiController
from mbf_relay.control.mppi.parameters import ACKERMANN, MppiParameters
from mbf_relay.control.steering import Steering
from mbf_relay.control.translated import TranslatedController
from mbf_relay.parameters import ParameterSet, convert, parameter

TURNS_A_SECOND = 5.0
"""Highest min_vel_theta in yaw tolerances per second: a faster turn could overshoot the heading within a cycle."""
RECONFIGURABLE = (
    "max_vel_x", "max_vel_x_backwards", "max_vel_y", "max_vel_trans", "max_vel_theta", "acc_lim_x", "acc_lim_y",
    "acc_lim_theta", "xy_goal_tolerance", "yaw_goal_tolerance",
)
"""Parameters of teb_local_planner that can be changed at run time: none that decides which controller drives."""
EBAND_RECONFIGURABLE = (
    "max_vel_lin", "min_vel_lin", "max_vel_th", "min_in_place_vel_th", "max_translational_acceleration",
    "max_rotational_acceleration", "xy_goal_tolerance", "yaw_goal_tolerance",
)
"""Parameters of eband_local_planner that can be changed at run time."""


@dataclass(frozen=True)
class _StandInParameters(ParameterSet):
    """Parameters of a stand-in. All others of the planner are covered by the one line `stands_in`."""

    stuck_timeout: float = stuck_timeout_parameter()

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return nothing: `stands_in` of the controllers says so of all."""
        return []

    @classmethod
    def deprecated_names(cls, values: Mapping[str, Any]) -> Dict[str, str]:
        """Return nothing: aliases here are names of other planners, not old ones."""
        return {}


@dataclass(frozen=True)
class TebParameters(_StandInParameters):
    """Parameters of teb_local_planner/TebLocalPlannerROS that are used, with its defaults (ROS Noetic)."""

    max_vel_x: float = parameter(0.4, "highest forward velocity", "m/s", minimum=0.01, maximum=100.0)
    max_vel_x_backwards: float = parameter(0.2, "highest speed backwards", "m/s", minimum=0.0, maximum=100.0)
    max_vel_y: float = parameter(
        0.0, "highest speed sideways; 0 for a robot that cannot drive sideways", "m/s", minimum=0.0, maximum=100.0)
    max_vel_trans: float = parameter(
        0.0, "highest translational speed of a robot that drives sideways; 0 for max_vel_x", "m/s", minimum=0.0,
        maximum=100.0)
    max_vel_theta: float = parameter(0.3, "highest rotational speed", "rad/s", minimum=0.01, maximum=100.0)
    acc_lim_x: float = parameter(0.5, "acceleration limit along x", "m/s^2", above=0.0, maximum=20.0)
    acc_lim_y: float = parameter(0.5, "acceleration limit along y", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_theta: float = parameter(0.5, "rotational acceleration limit", "rad/s^2", above=0.0, maximum=20.0)
    min_turning_radius: float = parameter(
        0.0, "smallest turning radius of a car-like robot; 0 for one that turns on the spot", "m", minimum=0.0)
    cmd_angle_instead_rotvel: bool = parameter(
        False, "command the steering angle (rad) in angular.z in place of a rotational velocity")
    wheelbase: float = parameter(
        1.0, "distance from the rear to the front axle, for cmd_angle_instead_rotvel; below 0 for rear-wheel steering",
        "m")
    xy_goal_tolerance: float = parameter(
        0.2, "distance to the goal at which its position counts as reached", "m", above=0.0, maximum=10.0)
    yaw_goal_tolerance: float = parameter(
        0.2, "angle to the goal's heading at which it counts as reached", "rad", above=0.0)
    odom_topic: str = parameter("", "topic of odometry, if the server's own odom_topic is not given; read at start")

    def check(self) -> None:
        """Raise ValueError for steering angles without a wheelbase, and for what cannot be driven."""
        if self.cmd_angle_instead_rotvel and self.wheelbase == 0.0:
            raise ValueError("wheelbase is 0.0 m; cmd_angle_instead_rotvel needs the car's, for steering angles")
        _driver_of(self)  # now: what is accepted at run time is translated later, when a goal would fail of it


class TebStandIn(TranslatedController):
    """Replaces teb_local_planner by DWA, for a car by MPPI."""

    Parameters: ClassVar[Type[ParameterSet]] = TebParameters
    parameters: TebParameters
    dynamic_config = "mbf_relay.cfg.TebLocalPlannerConfig"
    stands_in = (
        "the dynamic window approach drives, and model predictive path integral control a car, with its velocities, "
        "accelerations and goal tolerances and the local costmap's footprint; its other parameters have no counterpart"
    )

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        p = self.of_teb(parameters)
        self.odom_topic = p.odom_topic
        if p.cmd_angle_instead_rotvel:
            self.steering = Steering(p.wheelbase, p.min_turning_radius)

    def of_teb(self, parameters: Any) -> TebParameters:
        """Return the parameters by teb_local_planner's names; subclasses override it."""
        teb: TebParameters = parameters
        return teb

    def translate(self, parameters: Any, resolution: float) -> Tuple[Type[PathFollower], Any]:
        """Return the class of controller for this kind of robot, and its parameters."""
        return _driver_of(self.of_teb(parameters))


def _driver_of(p: TebParameters) -> Tuple[Type[PathFollower], Any]:
    """Return the class of controller for this kind of robot, and its parameters; ValueError where it refuses them."""
    if p.min_turning_radius > 0.0:
        return MppiController, _of_a_car(p)
    sideways = p.max_vel_y if p.acc_lim_y > 0.0 else 0.0
    fastest = p.max_vel_trans if sideways and p.max_vel_trans else max(p.max_vel_x, sideways)
    return DwaController, _usual(
        max_vel_trans=fastest,
        max_vel_x=p.max_vel_x,
        min_vel_x=-p.max_vel_x_backwards,
        max_vel_y=sideways,
        min_vel_y=-sideways,
        max_vel_theta=p.max_vel_theta,
        acc_lim_x=p.acc_lim_x,
        acc_lim_y=p.acc_lim_y,
        acc_lim_theta=p.acc_lim_theta,
        xy_goal_tolerance=p.xy_goal_tolerance,
        yaw_goal_tolerance=p.yaw_goal_tolerance,
    )


@dataclass(frozen=True)
class EBandParameters(_StandInParameters):
    """Parameters of eband_local_planner/EBandPlannerROS and pose_follower/PoseFollower that are used."""

    max_vel_lin: float = parameter(0.75, "highest translational speed", "m/s", minimum=0.0, maximum=100.0)
    min_vel_lin: float = parameter(0.1, "lowest translational speed commanded", "m/s", minimum=0.0)
    max_vel_th: float = parameter(1.0, "highest rotational speed", "rad/s", minimum=0.0, maximum=100.0)
    min_in_place_vel_th: float = parameter(0.0, "lowest rotational speed of a turn on the spot", "rad/s", minimum=0.0)
    max_translational_acceleration: float = parameter(
        0.5, "acceleration limit along x and y", "m/s^2", above=0.0, maximum=20.0
    )
    max_rotational_acceleration: float = parameter(
        1.5, "rotational acceleration limit", "rad/s^2", above=0.0, maximum=20.0
    )
    differential_drive: bool = parameter(True, "true: the robot does not drive sideways")
    xy_goal_tolerance: float = parameter(
        0.1, "distance to the goal at which its position counts as reached", "m", above=0.0,
        aliases=("tolerance_trans",))
    yaw_goal_tolerance: float = parameter(
        0.05, "angle to the goal's heading at which it counts as reached", "rad", above=0.0, aliases=("tolerance_rot",))

    def check(self) -> None:
        """Raise ValueError for what cannot be driven."""
        _of_eband(self)  # now, as for TEB


class EBandStandIn(TranslatedController):
    """Replaces eband_local_planner by DWA."""

    Parameters = EBandParameters
    parameters: EBandParameters
    dynamic_config = "mbf_relay.cfg.EBandPlannerConfig"
    stands_in = (
        "the dynamic window approach drives, with its velocities, accelerations and goal tolerances and the local "
        "costmap's footprint; its other parameters have no counterpart"
    )

    def translate(self, parameters: EBandParameters, resolution: float) -> Tuple[Type[PathFollower], DwaParameters]:
        """Return DwaController and its parameters for the same robot."""
        return DwaController, _of_eband(parameters)


def _of_eband(p: EBandParameters) -> DwaParameters:
    """Return DWA's parameters for the same robot; ValueError where it refuses them."""
    sideways = 0.0 if p.differential_drive else p.max_vel_lin
    return _usual(
        max_vel_trans=p.max_vel_lin, min_vel_trans=min(p.min_vel_lin, p.max_vel_lin), max_vel_x=p.max_vel_lin,
        min_vel_x=0.0, max_vel_y=sideways, min_vel_y=-sideways, max_vel_theta=p.max_vel_th,
        min_vel_theta=min(p.min_in_place_vel_th, p.max_vel_th), acc_lim_x=p.max_translational_acceleration,
        acc_lim_y=p.max_translational_acceleration, acc_lim_theta=p.max_rotational_acceleration,
        xy_goal_tolerance=p.xy_goal_tolerance, yaw_goal_tolerance=p.yaw_goal_tolerance,
    )


class PoseFollowerStandIn(EBandStandIn):
    """Replaces pose_follower by DWA."""

    dynamic_config = ""  # it calls the tolerances otherwise


@dataclass(frozen=True)
class DwbParameters(_StandInParameters):
    """Parameters of dwb_local_planner's DWBLocalPlanner and neo_local_planner/NeoLocalPlanner that are used."""

    max_vel_x: float = parameter(0.55, "highest forward velocity", "m/s", minimum=0.0, maximum=100.0)
    min_vel_x: float = parameter(0.0, "lowest forward velocity; below 0 allows driving backwards", "m/s")
    max_vel_y: float = parameter(
        0.0, "highest velocity to the left; DWB's default, 0.1, is none for robots that cannot drive sideways", "m/s")
    min_vel_y: float = parameter(
        0.0, "lowest velocity to the left; below 0 allows driving to the right, as DWB's default, -0.1, does", "m/s")
    max_speed_xy: float = parameter(
        0.55, "highest translational speed", "m/s", minimum=0.0, maximum=100.0,
        aliases=("max_trans_vel", "max_vel_trans"))
    min_speed_xy: float = parameter(
        0.1, "lowest translational speed commanded", "m/s", minimum=0.0, aliases=("min_trans_vel", "min_vel_trans"))
    max_vel_theta: float = parameter(
        1.0, "highest rotational speed", "rad/s", minimum=0.0, maximum=100.0, aliases=("max_rot_vel",))
    min_speed_theta: float = parameter(
        0.4, "lowest rotational speed of a turn on the spot", "rad/s", minimum=0.0, aliases=("min_rot_vel",))
    acc_lim_x: float = parameter(2.5, "acceleration limit along x", "m/s^2", above=0.0, maximum=20.0)
    acc_lim_y: float = parameter(2.5, "acceleration limit along y", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_theta: float = parameter(3.2, "rotational acceleration limit", "rad/s^2", above=0.0, maximum=20.0)
    xy_goal_tolerance: float = parameter(
        0.25, "distance to the goal at which its position counts as reached", "m", above=0.0)
    yaw_goal_tolerance: float = parameter(
        0.25, "angle to the goal's heading at which it counts as reached", "rad", above=0.0)


class DwbStandIn(TranslatedController):
    """Replaces DWB by DWA."""

    Parameters = DwbParameters
    stands_in = EBandStandIn.stands_in

    def translate(self, parameters: DwbParameters, resolution: float) -> Tuple[Type[PathFollower], DwaParameters]:
        """Return DwaController and its parameters for the same robot."""
        p = parameters
        left, right = (max(0.0, p.max_vel_y), min(0.0, p.min_vel_y)) if p.acc_lim_y > 0.0 else (0.0, 0.0)
        return DwaController, _usual(
            max_vel_trans=p.max_speed_xy, min_vel_trans=min(p.min_speed_xy, p.max_speed_xy), max_vel_x=p.max_vel_x,
            min_vel_x=min(p.min_vel_x, p.max_vel_x), max_vel_y=left, min_vel_y=right,
            max_vel_theta=p.max_vel_theta,
            min_vel_theta=min(p.min_speed_theta, p.max_vel_theta, TURNS_A_SECOND * p.yaw_goal_tolerance),
            acc_lim_x=p.acc_lim_x, acc_lim_y=p.acc_lim_y, acc_lim_theta=p.acc_lim_theta,
            xy_goal_tolerance=p.xy_goal_tolerance, yaw_goal_tolerance=p.yaw_goal_tolerance,
        )


class NeoStandIn(DwbStandIn):
    """Replaces neo_local_planner by DWA."""


STEERED = ("simple_car", "kinematic_bicycle_vel_input")
"""mpc_local_planner's types of robots that are commanded with a steering angle (rad)."""


@dataclass(frozen=True)
class MpcParameters(_StandInParameters):
    """Parameters of mpc_local_planner/MpcLocalPlannerROS that are used."""

    robot: Dict[str, Any] = parameter(
        {}, "`type` (unicycle, simple_car or kinematic_bicycle_vel_input) and a group of that name with max_vel_x, "
        "max_vel_x_backwards, max_vel_theta, acc_lim_x, acc_lim_theta; for a car also max_steering_angle and either "
        "wheelbase or length_rear and length_front")
    controller: Dict[str, Any] = parameter(
        {}, "group with xy_goal_tolerance (default 0.2 m) and yaw_goal_tolerance (default 0.1 rad)")
    odom_topic: str = parameter("", "topic of odometry, if the server's own odom_topic is not given; read at start")

    def check(self) -> None:
        """Raise ValueError for an unknown type of robot, or one that cannot be steered."""
        self.as_teb()

    def read_as(self) -> List[str]:
        """Return notes on limits that were out of range."""
        return TebParameters.read(self._flat())[1]

    def as_teb(self) -> TebParameters:
        """Return teb_local_planner's parameters for the same robot.

        Raises:
            ValueError: The type of robot is unknown, or the car cannot be steered.
        """
        return TebParameters.read(self._flat())[0]

    def _flat(self) -> Dict[str, Any]:
        """Return values by TebParameters' names; accelerations of 0, unlimited upstream, become defaults."""
        robot, controller = _group("robot", self.robot), _group("controller", self.controller)
        kind = robot.get("type", "unicycle")
        if kind not in ("unicycle", *STEERED):
            raise ValueError(f"parameter robot/type is {kind!r}; it must be unicycle, {' or '.join(STEERED)}")
        model = _group(f"robot/{kind}", robot.get(kind, {}))
        made = {"yaw_goal_tolerance": 0.1, "odom_topic": self.odom_topic}
        made.update({name: model[name] for name in ("max_vel_x", "max_vel_x_backwards", "max_vel_theta")
                     if name in model})
        made.update({name: model[name] for name in ("acc_lim_x", "acc_lim_theta") if model.get(name, 0) != 0})
        made.update({name: controller[name] for name in ("xy_goal_tolerance", "yaw_goal_tolerance")
                     if name in controller})
        return {**made, **(_steered(model, kind) if kind in STEERED else {})}


def _group(name: str, values: Any) -> Mapping[str, Any]:
    """Return a group of parameters; raise ValueError if `values` is none."""
    if not isinstance(values, Mapping):
        raise ValueError(f"parameter {name} is {values!r}; it must be a group of parameters")
    return values


def _steered(model: Mapping[str, Any], kind: str) -> Dict[str, Any]:
    """Return TebParameters' values of a car that is commanded with a steering angle."""
    names = {"length_rear": 1.0, "length_front": 1.0} if kind == "kinematic_bicycle_vel_input" else {"wheelbase": 0.5}
    wheelbase = sum(float(convert(name, model.get(name, usual), float)) for name, usual in names.items())
    angle = float(convert("max_steering_angle", model.get("max_steering_angle", 1.5), float))
    if not (0.0 < angle < 0.5 * math.pi and 0.0 < wheelbase < math.inf):
        raise ValueError(f"a car of wheelbase {wheelbase:g} m that steers by {angle:g} rad at most cannot be steered")
    return {
        "wheelbase": wheelbase, "cmd_angle_instead_rotvel": True, "min_turning_radius": wheelbase / math.tan(angle),
        "max_vel_theta": 100.0,  # the circle is what limits it
    }


class MpcStandIn(TebStandIn):
    """Replaces mpc_local_planner as TebStandIn does teb_local_planner."""

    Parameters = MpcParameters
    dynamic_config = ""

    def of_teb(self, parameters: MpcParameters) -> TebParameters:
        """Return the parameters by teb_local_planner's names."""
        return parameters.as_teb()


def _of_a_car(p: TebParameters) -> MppiParameters:
    """Return MPPI's parameters for a car; the horizon covers braking and then a turning radius at top speed."""
    ahead = p.max_vel_x / p.acc_lim_x + p.min_turning_radius / p.max_vel_x
    turn = min(p.max_vel_theta, p.max_vel_x / p.min_turning_radius)
    return MppiParameters(
        motion_model=ACKERMANN, min_turning_r=p.min_turning_radius, max_vel_trans=p.max_vel_x, min_vel_trans=0.0,
        max_vel_x=p.max_vel_x, min_vel_x=-p.max_vel_x_backwards, max_vel_theta=turn, min_vel_theta=0.0,
        acc_lim_x=p.acc_lim_x, acc_lim_theta=p.acc_lim_theta, xy_goal_tolerance=p.xy_goal_tolerance,
        yaw_goal_tolerance=p.yaw_goal_tolerance, model_dt=0.1, time_steps=max(30, min(60, math.ceil(10.0 * ahead))),
        vx_std=0.4 * p.max_vel_x, wz_std=0.3 * turn, prune_distance=max(1.5, 2.0 * p.min_turning_radius),
        turn_to_path_angle=math.tau,
    )


def _usual(**limits: Any) -> DwaParameters:
    """Return DWA's parameters with these limits, and the weights and samples of the tutorials' robots."""
    values = dict(
        min_vel_trans=min(0.1, limits["max_vel_trans"]), min_vel_theta=min(0.2, limits["max_vel_theta"]), vx_samples=12,
        vy_samples=5 if limits["max_vel_y"] else 0, vth_samples=30, path_distance_bias=32.0, goal_distance_bias=20.0,
        occdist_scale=0.02,
    )
    braking = limits["max_vel_x"] / limits["acc_lim_x"]
    return DwaParameters(**{**values, "sim_time": min(4.0, max(1.7, math.ceil(10.0 * braking) / 10.0)), **limits})
