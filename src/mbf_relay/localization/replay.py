"""Replay of a recorded log through the filter, and its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angles
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import CHECK_THRESHOLDS, OccupancyMap

LOST_FROM = 1.0
"""Error (m) from which a robot counts as lost."""


@dataclass(frozen=True)
class Replay:
    """Result of a replay.

    Attributes:
        poses: Shape (N, 3): estimate x, y (m), yaw (rad) at each scan.
        updated: Shape (N,): whether the scan updated the filter.
        seconds: Shape (N,): computing time (s) of each scan by the given clock; zero without one.
        unusable: Shape (N,): whether the filter refused the scan or its odometry.
    """

    poses: np.ndarray
    updated: np.ndarray
    seconds: np.ndarray
    unusable: np.ndarray


def replay(
    log: RecordedLog, occupancy: OccupancyMap, parameters: LocalizerParameters, rng: np.random.Generator,
    start: Optional[Pose2D], covariance: np.ndarray, clock: Callable[[], float] = lambda: 0.0,
) -> Replay:
    """Run the filter over a log.

    Args:
        log: The drive.
        occupancy: The map.
        parameters: Of the filter.
        rng: Random generator of the filter.
        start: Pose at the first scan; anywhere on the map where None.
        covariance: Of the start, shape (3, 3).
        clock: Read before and after every scan.

    Raises:
        ValueError: The map has no cell, or no free one to start anywhere on, or the start is not on it.
    """
    localizer = Localizer(parameters, occupancy, rng)
    if start is not None:
        localizer.set_initial_pose(start, covariance)
    elif not localizer.field.has_free_cells:
        raise ValueError(f"the map has no free cell to start on; {CHECK_THRESHOLDS}")
    poses, updated, seconds = np.empty((len(log), 3)), np.zeros(len(log), dtype=bool), np.zeros(len(log))
    unusable = np.zeros(len(log), dtype=bool)
    pose = start if start is not None else Pose2D(0.0, 0.0, 0.0)
    for index in range(len(log)):
        odom_pose, began = log.odom_pose(index), clock()
        try:
            updated[index] = localizer.process(odom_pose, log.scan(index), log.laser_pose) is not None
        except ValueError:
            unusable[index] = True
        seconds[index] = clock() - began
        if localizer.map_from_odom is not None and odom_pose.is_finite():
            pose = localizer.map_from_odom.compose(odom_pose)
        poses[index] = pose
    return Replay(poses, updated, seconds, unusable)


def require_use(result: Replay, log: str) -> None:
    """Raise ValueError where no scan of a log, of that name, could be used: poses are then nothing but the start's."""
    if not result.updated.any():
        raise ValueError(f"none of the {len(result.updated)} scans of log {log} could be used; their ranges or the "
                         "odometry are no numbers")


def errors(poses: np.ndarray, reference: np.ndarray) -> Dict[str, np.ndarray]:
    """Return the distances (m) and the turns (rad, positive) between two trajectories, each of shape (N, 3)."""
    return {
        "translation": np.hypot(poses[:, 0] - reference[:, 0], poses[:, 1] - reference[:, 1]),
        "rotation": np.abs(normalize_angles(poses[:, 2] - reference[:, 2])),
    }


def summarize(result: Replay, log: RecordedLog) -> Dict[str, Any]:
    """Return the figures of a replay: errors where there is a reference, and times (s) per update."""
    figures: Dict[str, Any] = {
        "scans": len(log), "updates": int(result.updated.sum()), "unusable": int(result.unusable.sum())}
    if log.reference is not None:
        known = np.isfinite(log.reference).all(axis=1)
        off = errors(result.poses[known], log.reference[known])
        if known.any():
            figures["translation_error"] = _spread(off["translation"])
            figures["rotation_error"] = _spread(off["rotation"])
            figures["lost_share"] = float((off["translation"] > LOST_FROM).mean())
    if result.updated.any():
        figures["seconds_per_update"] = _spread(result.seconds[result.updated])
    return figures


def _spread(values: np.ndarray) -> Dict[str, float]:
    return {
        "mean": float(values.mean()), "median": float(np.median(values)), "p95": float(np.percentile(values, 95)),
        "max": float(values.max()),
    }
