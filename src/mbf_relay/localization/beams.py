"""Beams: the readings of a scan that the filter uses, in the frame of the robot's base."""

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
        silent: Bool of shape (B,): nothing came back from this beam and from its neighbours on both sides. A single
            beam without a return is taken for a measuring error, and a reading below the minimum is not silent.
        laser_pose: Pose of the sensor in the base's frame.
        range_max: Upper limit (m), excluded, of valid readings.
    """

    ranges: np.ndarray
    bearings: np.ndarray
    endpoints: np.ndarray
    silent: np.ndarray
    laser_pose: Pose2D
    range_max: float

    @property
    def hits(self) -> np.ndarray:
        """Endpoints (m) of the beams with a return, shape (H, 2), in the base's frame, contiguous."""
        return np.ascontiguousarray(self.endpoints[self.ranges < self.range_max])

    @property
    def passed(self) -> np.ndarray:
        """Points (m) at `range_max` along the silent beams, shape (S, 2), in the base's frame, contiguous."""
        return np.ascontiguousarray(self.endpoints[self.silent])


def step_between(count: int, max_beams: int, rounded_up: bool) -> int:
    """Return n where amcl uses every n-th of `count` beams to get `max_beams`; its models round it up or down."""
    if rounded_up:
        return max(1, -(-count // max_beams))
    return max(1, (count - 1) // (max_beams - 1))


def limits_of(scan: LaserScan, laser_min_range: float = -1.0, laser_max_range: float = -1.0) -> Tuple[float, float]:
    """Return the limits (m), both excluded, of a scan's valid readings.

    Args:
        scan: The scan.
        laser_min_range, laser_max_range: The user's limits (m), which narrow the scan's own; unused if not above 0.

    Raises:
        ValueError: The upper limit is not above 0, or the lower one is below 0 or NaN.
    """
    range_max = min(scan.range_max, laser_max_range) if laser_max_range > 0.0 else scan.range_max
    range_min = max(scan.range_min, laser_min_range) if laser_min_range > 0.0 else scan.range_min
    if not (range_max > 0.0 and range_min >= 0.0):
        raise ValueError(
            f"scan of '{scan.frame}' reaches from {range_min} to {range_max} m; the limits must be positive numbers"
        )
    return range_min, range_max


def is_hit(ranges: np.ndarray, limits: Tuple[float, float]) -> np.ndarray:
    """Return which readings are valid, bool of their shape.

    Args:
        ranges: Readings (m); NaN and infinite ones are not valid.
        limits: See `limits_of`.
    """
    with np.errstate(invalid="ignore"):
        hit: np.ndarray = (ranges > limits[0]) & (ranges < limits[1])
    return hit


def pick_beams(
    scan: LaserScan, laser_pose: Pose2D, step: int, laser_min_range: float = -1.0, laser_max_range: float = -1.0
) -> Beams:
    """Pick every `step`-th reading of a scan.

    NaN readings are left out. Readings outside of the limits become `range_max`, "nothing came back", as in amcl.

    Args:
        scan: The scan, with its angles in the frame whose pose in the base's frame is `laser_pose`.
        laser_pose: Pose of the sensor in the base's frame.
        step: Every how many readings one is picked.
        laser_min_range, laser_max_range: See `limits_of`.

    Raises:
        ValueError: As `limits_of`.
    """
    limits, most = limits_of(scan, laser_min_range, laser_max_range), len(scan.ranges)
    ranges, bearings, endpoints, silent = np.empty(most), np.empty(most), np.empty((most, 2)), np.empty(most, bool)
    count = pick(
        np.ascontiguousarray(scan.ranges, dtype=float), step, scan.angle_min, scan.angle_increment,
        np.array(laser_pose, dtype=float), *limits, ranges, bearings, endpoints, silent,
    )
    return Beams(ranges[:count], bearings[:count], endpoints[:count], silent[:count], laser_pose, limits[1])
