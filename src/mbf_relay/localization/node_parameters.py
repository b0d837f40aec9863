"""Parameters of the amcl node: those of its filter, and those for frames, topics and saved poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Mapping, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.kept_pose import SAVED_ODOM
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.parameters import convert, parameter, without_effect


@dataclass(frozen=True)
class AmclParameters(LocalizerParameters):
    """Parameters of amcl that can be changed while it runs, with its names and defaults."""

    transform_tolerance: float = parameter(
        0.1, "how far into the future map -> odom is stamped, for which it stays valid", unit="s", minimum=0.0,
        maximum=2.0)
    gui_publish_rate: float = without_effect(-1.0, "amcl's files have it", unit="Hz")
    save_pose_rate: float = parameter(
        0.5, "how often the pose is stored on the parameter server, for the next start; -1 for never", unit="Hz")
    tf_broadcast: bool = parameter(True, "publish map -> odom on /tf")
    use_map_topic: bool = parameter(False, "take the map from the topic 'map' instead of from the service static_map")
    first_map_only: bool = parameter(False, "use only the first map of the topic and ignore later ones")
    force_update_after_initialpose: bool = parameter(
        False, "update with the next scan after an initial pose, even if the robot stands")
    force_update_after_set_map: bool = parameter(
        False, "update with the next scan after the service set_map, even if the robot stands")
    odom_frame_id: str = parameter("odom", "frame of the odometry", is_frame=True)
    base_frame_id: str = parameter("base_link", "frame of the robot", is_frame=True)
    global_frame_id: str = parameter("map", "frame of the map", is_frame=True)
    std_warn_level_x: float = parameter(
        0.2, "standard deviation in x above which diagnostics warn", unit="m", minimum=0.0)
    std_warn_level_y: float = parameter(
        0.2, "standard deviation in y above which diagnostics warn", unit="m", minimum=0.0)
    std_warn_level_yaw: float = parameter(
        0.1, "standard deviation in yaw above which diagnostics warn", unit="rad", minimum=0.0)


NODE_ONLY = ("seed", "bag_scan_period", "start_anywhere", "cloud", SAVED_ODOM)
"""Names read once at start, beside AmclParameters and the initial pose."""

INITIAL: Dict[str, float] = {
    "initial_pose_x": 0.0, "initial_pose_y": 0.0, "initial_pose_a": 0.0,
    "initial_cov_xx": 0.25, "initial_cov_yy": 0.25, "initial_cov_aa": (math.pi / 12.0) ** 2,
}


def seed_from(values: Mapping[str, Any], otherwise: int) -> Tuple[int, str]:
    """Return the seed of the random generator, and a note if the given one is invalid and `otherwise` is used."""
    given = values.get("seed", otherwise)
    try:
        seed = int(convert("seed", given, int))
    except ValueError as error:
        return otherwise, f"{error}: {otherwise} is used"
    if seed < 0:
        return otherwise, f"parameter seed is {seed}; it must be at least 0: {otherwise} is used"
    return seed, ""


def initial_pose_from(values: Mapping[str, Any]) -> Tuple[Pose2D, np.ndarray, Tuple[str, ...]]:
    """Return the initial pose, its covariance, shape (3, 3), and the names left at their defaults as invalid."""
    given = {name: values[name] for name in INITIAL if values.get(name) is not None}
    refused = tuple(name for name, value in given.items() if not _is_valid(name, value))
    taken = {**INITIAL, **{name: float(value) for name, value in given.items() if name not in refused}}
    pose = Pose2D(taken["initial_pose_x"], taken["initial_pose_y"], taken["initial_pose_a"])
    covariance = np.diag([taken["initial_cov_xx"], taken["initial_cov_yy"], taken["initial_cov_aa"]])
    return pose, covariance, refused


def _is_valid(name: str, value: Any) -> bool:
    """Return whether a value is a finite number and, of a covariance, 0 or more."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return False
    return value >= 0.0 or not name.startswith("initial_cov")


def require_initial_pose(values: Mapping[str, Any]) -> None:
    """Raise ValueError for an invalid value of initial pose or covariance, where a default must not replace it."""
    for name in initial_pose_from(values)[2]:
        raise ValueError(f"parameter {name} is {values[name]!r}; it must be a finite number, of a covariance 0 or more")


def initial_pose_as_parameters(pose: Pose2D, covariance: np.ndarray) -> Dict[str, float]:
    """Return a pose and the variances of its covariance, shape (3, 3), by the parameters' names."""
    values = (pose.x, pose.y, pose.theta, covariance[0, 0], covariance[1, 1], covariance[2, 2])
    return {name: float(value) for name, value in zip(INITIAL, values)}
