"""Validation of an initial pose."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap


def check_initial_pose(pose: Pose2D, covariance: np.ndarray, occupancy: OccupancyMap) -> None:
    """Raise ValueError for a pose that is not finite or off the map, or an unusable covariance, shape (3, 3)."""
    covariance = np.asarray(covariance, dtype=float)
    if not pose.is_finite():
        raise ValueError(f"initial pose {tuple(pose)} is not finite")
    if covariance.shape != (3, 3) or not np.isfinite(covariance).all():
        raise ValueError(f"covariance of the initial pose {covariance.tolist()} is no finite 3 x 3 matrix")
    deviation = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1])))
    widest = occupancy.resolution * math.hypot(*occupancy.data.shape)
    if deviation > widest:
        raise ValueError(
            f"covariance of the initial pose has a deviation of {deviation:.3g} m, and the map is {widest:.1f} m from "
            "corner to corner; global_localization is for a robot that may be anywhere")
    if not occupancy.contains_point(pose.x, pose.y):
        raise ValueError(f"initial pose ({pose.x:.3f}, {pose.y:.3f}) is not on the map; choose a place on it")
