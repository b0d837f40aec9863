"""Parameters every path follower has: limits, accelerations, tolerances, and when to give up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, List, Mapping, Tuple, Type, TypeVar

from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.parameters import ParameterSet, parameter

F = TypeVar("F", bound="FollowerParameters")

SLOWEST = 1000.0
"""Seconds: no robot takes longer to its top speed; its trajectories are followed until it could have stopped."""


def check_acceleration(name: str, acceleration: float, fastest: float) -> None:
    """Refuse an acceleration with which a robot never comes to its top speed, nor to a stand.

    Args:
        name: Of the parameter.
        acceleration: Its value (m/s^2 or rad/s^2).
        fastest: That speed (m/s or rad/s).
    """
    if fastest > 0.0 and acceleration * SLOWEST < fastest:
        raise ValueError(
            f"parameter {name} is {acceleration:g}, so the robot could never reach or leave {fastest:g}; it must be "
            f"above 0, and at least {fastest / SLOWEST:g}"
        )


@dataclass(frozen=True)
class FollowerParameters(ParameterSet):
    """Limits and tolerances by the names and with the defaults of base_local_planner's LocalPlannerLimits (ROS Noetic).
    """

    max_vel_trans: float = parameter(0.55, "top translational speed", "m/s", minimum=0.0, aliases=("max_trans_vel",))
    min_vel_trans: float = parameter(
        0.1, "slowest translation worth commanding, except to start, to brake, together with a turn of at least "
        "min_vel_theta, or where nothing faster serves", "m/s", minimum=0.0, aliases=("min_trans_vel",),
    )
    max_vel_x: float = parameter(0.55, "top forward velocity", "m/s")
    min_vel_x: float = parameter(0.0, "lowest forward velocity; below 0 allows driving backwards", "m/s")
    max_vel_y: float = parameter(0.1, "top velocity to the left", "m/s")
    min_vel_y: float = parameter(-0.1, "lowest velocity to the left; below 0 is to the right", "m/s")
    max_vel_theta: float = parameter(1.0, "top rotational speed", "rad/s", minimum=0.0, aliases=("max_rot_vel",))
    min_vel_theta: float = parameter(
        0.4, "slowest turn on the spot worth commanding, except to start and to brake", "rad/s", minimum=0.0,
        aliases=("min_rot_vel",),
    )
    acc_lim_x: float = parameter(2.5, "acceleration limit along x", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_y: float = parameter(2.5, "acceleration limit along y", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_theta: float = parameter(
        3.2, "rotational acceleration limit", "rad/s^2", minimum=0.0, maximum=20.0, aliases=("acc_lim_th",)
    )
    acc_lim_trans: float = parameter(
        0.1, "read, and without effect, as in dwa_local_planner", "m/s^2", minimum=0.0, aliases=("acc_limit_trans",)
    )
    prune_plan: bool = parameter(
        False, "read, and without effect: the path is always followed from the nearest point on"
    )
    xy_goal_tolerance: float = parameter(0.1, "distance to the goal that counts as there", "m", above=0.0)
    yaw_goal_tolerance: float = parameter(0.1, "angle to the goal's heading that counts as there", "rad", above=0.0)
    trans_stopped_vel: float = parameter(0.1, "translation below this is standing", "m/s", minimum=0.0)
    theta_stopped_vel: float = parameter(
        0.1, "rotation below this is standing", "rad/s", minimum=0.0, aliases=("rot_stopped_vel",)
    )
    latch_xy_goal_tolerance: bool = parameter(False, "once at the goal's position only turn, until the goal changes")
    stop_time_buffer: float = parameter(
        0.2, "time before braking in which a collision rules a velocity out", "s", minimum=0.0
    )

    foresight: bool = parameter(
        False, "meet nothing that moves where it will be when the robot gets there; upstream's controllers see what is")
    foresight_horizon: float = parameter(2.0, "how far ahead in time it looks", "s", above=0.0)
    missed_path_distance: float = parameter(
        0.5, "distance to the path beyond which it is missed; twice the robot's width at least", "m", above=0.0
    )
    stuck_timeout: float = parameter(
        2.0, "time without any of the motion commanded that means stuck; 0 never", "s", minimum=0.0
    )
    blocked_timeout: float = parameter(0.5, "time the goal must be occupied to be given up", "s", minimum=0.0)

    ORDERED: ClassVar[Tuple[Tuple[str, str], ...]] = (
        ("min_vel_x", "max_vel_x"), ("min_vel_y", "max_vel_y"), ("min_vel_trans", "max_vel_trans"),
        ("min_vel_theta", "max_vel_theta"),
    )

    @classmethod
    def read(cls: Type[F], values: Mapping[str, Any]) -> Tuple[F, List[str]]:
        """Make one as ParameterSet.read does; a robot given no acceleration sideways does not move sideways, as in C++.
        """
        if cls.known(values).get("acc_lim_y") == 0.0:
            values = {**values, "min_vel_y": 0.0, "max_vel_y": 0.0}
        return super().read(values)

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names in `values` that mean nothing here; a rate beside them is that of the server's cycles."""
        return [name for name in super().unknown_names(values) if name not in ("controller_frequency", "sim_period")]

    def check(self) -> None:
        """Refuse a motion that has a speed and no acceleration."""
        for acceleration, fastest in (
            ("acc_lim_x", max(self.max_vel_x, -self.min_vel_x)), ("acc_lim_y", max(self.max_vel_y, -self.min_vel_y)),
            ("acc_lim_theta", self.max_vel_theta),
        ):
            check_acceleration(acceleration, getattr(self, acceleration), fastest)

    def require_motion(self) -> None:
        """Raise ControlError NO_VALID_CMD where top speeds of 0 keep the robot from following any path."""
        if self.max_vel_trans > 0.0 and max(self.max_vel_x, self.max_vel_y, -self.min_vel_y) > 0.0:
            return
        named = [name for name in ("max_vel_trans", "max_vel_x") if getattr(self, name) <= 0.0]
        limits = " and ".join(f"{name} is {getattr(self, name):g}" for name in named)
        raise ControlError(ControlOutcome.NO_VALID_CMD, f"the robot cannot follow its path: {limits}")
