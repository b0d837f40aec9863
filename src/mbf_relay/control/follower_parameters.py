"""Parameters of every path follower: limits, accelerations, tolerances, and timeouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, List, Mapping, Tuple, Type, TypeVar

from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.parameters import ParameterSet, parameter, without_effect

F = TypeVar("F", bound="FollowerParameters")

SLOWEST = 1000.0
"""Longest time (s) from standstill to top speed: trajectories are simulated until the robot could have stopped."""


def stuck_timeout_parameter() -> Any:
    """Declare the parameter `stuck_timeout`, which sets named after other packages' planners have too."""
    return parameter(
        2.0, "time without any motion, although commanded, after which the robot counts as stuck; 0 for never", "s",
        minimum=0.0)


def check_acceleration(name: str, acceleration: float, fastest: float) -> None:
    """Raise ValueError for an acceleration that takes longer than SLOWEST to the top speed.

    Args:
        name: The acceleration's parameter.
        acceleration: Its value (m/s^2 or rad/s^2).
        fastest: Top speed (m/s or rad/s).
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

    max_vel_trans: float = parameter(
        0.55, "highest translational speed", "m/s", minimum=0.0, aliases=("max_trans_vel",))
    min_vel_trans: float = parameter(
        0.1, "lowest translational speed commanded, except to start, to brake, together with a turn of at least "
        "min_vel_theta, or if nothing faster is possible", "m/s", minimum=0.0, aliases=("min_trans_vel",))
    max_vel_x: float = parameter(0.55, "highest forward velocity", "m/s")
    min_vel_x: float = parameter(0.0, "lowest forward velocity; below 0 allows driving backwards", "m/s")
    max_vel_y: float = parameter(0.1, "highest velocity to the left", "m/s")
    min_vel_y: float = parameter(-0.1, "lowest velocity to the left; below 0 allows driving to the right", "m/s")
    max_vel_theta: float = parameter(1.0, "highest rotational speed", "rad/s", minimum=0.0, aliases=("max_rot_vel",))
    min_vel_theta: float = parameter(
        0.4, "lowest rotational speed of a turn on the spot, except to start and to brake", "rad/s", minimum=0.0,
        aliases=("min_rot_vel",))
    acc_lim_x: float = parameter(2.5, "acceleration limit along x", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_y: float = parameter(
        2.5, "acceleration limit along y; with 0 the robot never drives sideways", "m/s^2", minimum=0.0, maximum=20.0)
    acc_lim_theta: float = parameter(
        3.2, "rotational acceleration limit", "rad/s^2", minimum=0.0, maximum=20.0, aliases=("acc_lim_th",)
    )
    acc_lim_trans: float = parameter(
        0.1, "read, and without effect, as in dwa_local_planner", "m/s^2", minimum=0.0, aliases=("acc_limit_trans",)
    )
    prune_plan: bool = without_effect(False, "the path is always followed from its nearest point")
    xy_goal_tolerance: float = parameter(
        0.1, "distance to the goal at which its position counts as reached", "m", above=0.0)
    yaw_goal_tolerance: float = parameter(
        0.1, "angle to the goal's heading at which it counts as reached", "rad", above=0.0)
    trans_stopped_vel: float = parameter(
        0.1, "translational speed below which the robot counts as stopped", "m/s", minimum=0.0)
    theta_stopped_vel: float = parameter(
        0.1, "rotational speed below which the robot counts as stopped", "rad/s", minimum=0.0,
        aliases=("rot_stopped_vel",))
    latch_xy_goal_tolerance: bool = parameter(
        False, "once within xy_goal_tolerance, only turn to the goal's heading until a new goal comes, even if the "
        "robot leaves it")
    stop_time_buffer: float = parameter(
        0.2, "a velocity is chosen only if the robot can keep it this long and then brake without a collision", "s",
        minimum=0.0)

    foresight: bool = parameter(
        False, "predict how moving obstacles go on and avoid them there; false avoids them where they are now, as "
        "upstream does")
    foresight_horizon: float = parameter(2.0, "how far ahead moving obstacles are predicted", "s", above=0.0)
    missed_path_distance: float = parameter(
        0.5, "distance from the path beyond which the controller gives up (MISSED_PATH); at least twice the robot's "
        "width is used", "m", above=0.0)
    stuck_timeout: float = stuck_timeout_parameter()
    blocked_timeout: float = parameter(
        0.5, "time an obstacle must stand on the goal before the controller gives up (BLOCKED_GOAL)", "s", minimum=0.0)

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
        """Return the names in `values` that are unknown here; rates of the control loop are the server's."""
        return [name for name in super().unknown_names(values) if name not in ("controller_frequency", "sim_period")]

    def check(self) -> None:
        """Raise ValueError where an axis has a top speed and no acceleration to reach it."""
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
