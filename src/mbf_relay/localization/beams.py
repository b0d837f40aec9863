"""Beams: the part of a scan that is weighed, in the robot's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.beam_kernels import pick
from mbf_relay.scan import LaserScan


@dataclass(frozen=True)
class Beams:
    """Readings picked from a scan.

    Attributes:
        ranges: Shape (B,) in metres, at most `range_max`; a reading of `range_max` stands for "nothing came back".
        bearings: Shape (B,) in radians, in the frame of the robot's base.
        endpoints: Shape (B, 2) in metres, in the frame of the robot's base.
        silent: Bool of shape (B,): nothing came back, nor from the beams to both sides; one that is alone is a
            lidar's lapse. What is too near to be measured is not silent.
        laser_pose: Pose of the sensor in the base's frame.
        range_max: Longest reading (m) that says where something is, itself excluded.
    """

    ranges: np.ndarray
    bearings: np.ndarray
    endpoints: np.ndarray
    silent: np.ndarray
    laser_pose: Pose2D
    range_max: float

    @property
    def hits(self) -> np.ndarray:
        """Endpoints of the readings that came back from something, shape (H, 2), contiguous."""
        return np.ascontiguousarray(self.endpoints[self.ranges < self.range_max])

    @property
    def passed(self) -> np.ndarray:
        """Where silent beams got to, shape (S, 2), contiguous."""
        return np.ascontiguousarray(self.endpoints[self.silent])


def step_between(count: int, max_beams: int, rounded_up: bool) -> int:
    """Return which share of `count` beams amcl takes: every n-th; its two families of models round differently."""
    if rounded_up:
        return max(1, -(-count // max_beams))
    return max(1, (count - 1) // (max_beams - 1))


def limits_of(scan: LaserScan, laser_min_range: float = -1.0, laser_max_range: float = -1.0) -> Tuple[float, float]:
    """Return the limits (m) between which, themselves excluded, a scan's readings say where something is.

    Args:
        scan: The scan.
        laser_min_range, laser_max_range: The user's limits (m); where not above 0 the scan's own hold.

    Raises:
        ValueError: The limits leave nothing.
    """
    range_max = min(scan.range_max, laser_max_range) if laser_max_range > 0.0 else scan.range_max
    range_min = max(scan.range_min, laser_min_range) if laser_min_range > 0.0 else scan.range_min
    if not (range_max > 0.0 and range_min >= 0.0):
        raise ValueError(
            f"scan of '{scan.frame}' reaches from {range_min} to {range_max} m; the limits must be positive numbers"
        )
    return range_min, range_max


def is_hit(ranges: np.ndarray, limits: Tuple[float, float]) -> np.ndarray:
    """Return which readings came back from something, bool of their shape.

    Args:
        ranges: Readings (m); NaN and infinite ones are none.
        limits: See `limits_of`.
    """
    with np.errstate(invalid="ignore"):
        hit: np.ndarray = (ranges > limits[0]) & (ranges < limits[1])
    return hit


def pick_beams(
    scan: LaserScan, laser_pose: Pose2D, step: int, laser_min_range: float = -1.0, laser_max_range: float = -1.0
) -> Beams:
    """Pick every `step`-th reading of a scan.

    NaN is no reading. What is not above the minimum becomes "nothing came back", as in amcl, and so does what is
    beyond the maximum.

    Args:
        scan: The scan; its angles are those in a frame that differs from the base's by `laser_pose`.
        laser_pose: Pose of the sensor in the base's frame.
        step: Distance between the beams picked.
        laser_min_range, laser_max_range: See `limits_of`.

    Raises:
        ValueError: The limits leave nothing.
    """
    limits, most = limits_of(scan, laser_min_range, laser_max_range), len(scan.ranges)
    ranges, bearings, endpoints, silent = np.empty(most), np.empty(most), np.empty((most, 2)), np.empty(most, bool)
    count = pick(
        np.ascontiguousarray(scan.ranges, dtype=float), step, scan.angle_min, scan.angle_increment,
        np.array(laser_pose, dtype=float), *limits, ranges, bearings, endpoints, silent,
    )
    return Beams(ranges[:count], bearings[:count], endpoints[:count], silent[:count], laser_pose, limits[1])
