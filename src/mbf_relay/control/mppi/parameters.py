"""Parameters of the MPPI controller, by the names of Nav2's MPPIController."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.mppi import CRITICS
from mbf_relay.parameters import number_spelt, parameter

DIFF_DRIVE, OMNI, ACKERMANN = "DiffDrive", "Omni", "Ackermann"


@dataclass(frozen=True)
class MppiParameters(FollowerParameters):
    """Parameters of MppiController, as Nav2's MPPIController reads them; limits go by either family's names."""

    max_vel_x: float = parameter(0.5, "highest forward velocity", "m/s", aliases=("vx_max",))
    min_vel_x: float = parameter(
        -0.35, "lowest forward velocity; below 0 allows driving backwards", "m/s", aliases=("vx_min",))
    max_vel_y: float = parameter(
        0.0, "highest velocity to the left, or with the name vy_max to either side; Omni only", "m/s")
    min_vel_y: float = parameter(0.0, "lowest velocity to the left; Omni only", "m/s")
    max_vel_theta: float = parameter(1.9, "highest rotational speed", "rad/s", minimum=0.0, aliases=("wz_max",))
    acc_lim_x: float = parameter(
        3.0, "acceleration limit along x, forward and braking; the smaller of ax_max and ax_min, if both are given",
        "m/s^2", minimum=0.0, maximum=20.0, aliases=("ax_max",))
    acc_lim_y: float = parameter(
        3.0, "acceleration limit along y", "m/s^2", minimum=0.0, maximum=20.0, aliases=("ay_max",)
    )
    acc_lim_theta: float = parameter(
        3.5, "rotational acceleration limit", "rad/s^2", minimum=0.0, maximum=20.0, aliases=("az_max",))

    motion_model: str = parameter(DIFF_DRIVE, "kinematics of the robot", choices=(DIFF_DRIVE, OMNI, ACKERMANN))
    min_turning_r: float = parameter(
        0.2, "smallest turning radius of an Ackermann robot; read here or, as in Nav2, from the group "
        "AckermannConstraints", "m", above=0.0)
    batch_size: int = parameter(1000, "number of sampled trajectories", minimum=10, maximum=100000)
    time_steps: int = parameter(56, "steps of each trajectory", minimum=2, maximum=1000)
    model_dt: float = parameter(0.05, "time between two steps of a trajectory", "s", above=0.0, maximum=1.0)
    iteration_count: int = parameter(1, "optimization rounds per control cycle", minimum=1, maximum=20)
    vx_std: float = parameter(0.2, "standard deviation of the noise on the forward velocity", "m/s", above=0.0)
    vy_std: float = parameter(
        0.2, "standard deviation of the noise on the sideways velocity; Omni only", "m/s", above=0.0)
    wz_std: float = parameter(0.4, "standard deviation of the noise on the rotational velocity", "rad/s", above=0.0)
    noise_time: float = parameter(
        0.5, "correlation time of the noise along a trajectory; 0 draws each step independently, as Nav2 does, and "
        "explores less", "s", minimum=0.0)
    temperature: float = parameter(
        0.3, "a trajectory whose cost is higher by this weighs less by a factor of e; lower trusts the best ones more",
        above=0.0)
    gamma: float = parameter(0.015, "weight of staying near the previous cycle's solution; 0 for none", minimum=0.0)
    retry_attempt_limit: int = parameter(
        1, "further attempts, starting from standstill, if no trajectory is free of collision", minimum=0, maximum=20)
    regenerate_noises: bool = parameter(False, "draw new noise in each cycle instead of once")
    seed: int = parameter(0, "seed of the noise", minimum=0)
    prune_distance: float = parameter(1.5, "length of the path ahead that is considered", "m", above=0.0)
    turn_to_path_angle: float = parameter(
        1.0, "angle to the path above which the robot first turns on the spot, like Nav2's rotation shim; above pi it "
        "never does", "rad", above=0.0)
    critics: Tuple[str, ...] = parameter(
        (
            "ConstraintCritic",
            "CostCritic",
            "GoalCritic",
            "GoalAngleCritic",
            "PathAlignCritic",
            "PathFollowCritic",
            "PathAngleCritic",
            "PreferForwardCritic",
        ),
        "critics whose costs are summed; package.module.Class adds one of your own; each has a group of parameters of "
        "its name")
    critic_parameters: Any = parameter({}, "read from the critics' groups; not to be set")

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the controller's values, with names that Nav2 has instead translated, and the critics' groups.
        """
        result = super().known(values)
        _translate_sideways(result, values)
        _translate_braking(result, values)
        numbers = {name: number for name, number in ((name, _number(value)) for name, value in result.items())
                   if number is not None}
        result.setdefault("max_vel_trans", math.hypot(numbers.get("max_vel_x", 0.5), numbers.get("max_vel_y", 0.0)))
        result.setdefault("min_vel_trans", 0.0)
        result.setdefault("min_vel_theta", min(0.4, numbers.get("max_vel_theta", 0.4)))
        turning = values.get("AckermannConstraints", {})
        if isinstance(turning, Mapping) and "min_turning_r" in turning:
            result["min_turning_r"] = turning["min_turning_r"]
        names = result.get("critics", cls.__dataclass_fields__["critics"].default)
        if isinstance(names, (list, tuple)):
            result["critic_parameters"] = {
                name: values[name] for name in names
                if isinstance(name, str) and isinstance(values.get(name), Mapping)
            }
        return result

    @classmethod
    def groups(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names of groups: all critics, those in `critics`, and Nav2's others."""
        names = values.get("critics", ())
        asked = [name for name in names if isinstance(name, str)] if isinstance(names, (list, tuple)) else []
        return [*NAV2_GROUPS, *CRITICS, *asked]

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names in `values` that are unknown here."""
        read = {"vy_max", "ax_min"} | set(NAV2_OF_ITS_OWN)
        return [name for name in super().unknown_names(values) if name not in read]

    @classmethod
    def deprecated_names(cls, values: Mapping[str, Any]) -> Dict[str, str]:
        """Return nothing: Nav2's names are no older than the others."""
        return {}


NAV2_GROUPS = ("AckermannConstraints", "TrajectoryVisualizer")
"""Groups in Nav2's files beside those of critics."""

NAV2_OF_ITS_OWN = (
    "visualize",
    "transform_tolerance",
    "max_robot_pose_search_dist",
    "enforce_path_inversion",
    "inversion_xy_tolerance",
    "inversion_yaw_tolerance",
    "reset_period",
    "publish_critics_stats",
)
"""Names in Nav2's files whose purpose is served otherwise here; they are ignored without a warning."""


def _number(value: Any) -> Optional[float]:
    """Return the number that a value is or spells; None for any other, which is refused by its name later."""
    if isinstance(value, str):
        return number_spelt(value)
    return value if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def _translate_sideways(result: Dict[str, Any], values: Mapping[str, Any]) -> None:
    """Set max_vel_y and min_vel_y by Nav2's vy_max, which is for both sides; both are 0 unless the robot is OMNI."""
    if result.get("motion_model") != OMNI:
        result.update(max_vel_y=0.0, min_vel_y=0.0)
    elif "vy_max" in values or not {"max_vel_y", "min_vel_y"} <= set(result):
        sideways = values.get("vy_max", result.get("max_vel_y", _opposite(result.get("min_vel_y", -0.5))))
        result.update(max_vel_y=sideways, min_vel_y=_opposite(sideways))


def _translate_braking(result: Dict[str, Any], values: Mapping[str, Any]) -> None:
    """Lower acc_lim_x, which is for both, to Nav2's ax_min, the limit for braking."""
    if "ax_min" not in values:
        return
    braking = _number(values["ax_min"])
    result.setdefault("acc_lim_x", values["ax_min"] if braking is None else 3.0)
    starting = _number(result["acc_lim_x"])
    if braking is not None and starting is not None:
        result["acc_lim_x"] = min(starting, abs(braking))


def _opposite(value: Any) -> Any:
    """Return the negative of the number that a value is or spells; any other value, to be refused, as it is."""
    number = _number(value)
    return value if number is None else -number
