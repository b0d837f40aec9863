"""What may hide where a lidar measured nothing: something nearer than it can measure, or a part of it that failed."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import gaps


def blind_points(scan: LaserScan, laser_in_base: Pose2D, width: float, outline: np.ndarray) -> np.ndarray:
    """Return points for what may hide where neighbouring beams measured nothing, shape (N, 2) in the base frame.

    What is nearer than range_min reads like a beam that failed. Nothing tells how near it is, so each such beam
    stands for something where it leaves the footprint.

    Args:
        scan: As seen from above.
        laser_in_base: Where the lidar sits.
        width: From which angle (rad) on neighbouring beams count; 0 for never, but for those that read minus infinity.
        outline: The footprint, shape (K, 2) in metres in the base frame.
    """
    blind = _in_long_runs(~scan.measured, width, scan) | np.isneginf(scan.ranges)
    if not blind.any():
        return np.empty((0, 2))
    angles = scan.angles[blind] + laser_in_base.theta
    beams = np.column_stack((np.cos(angles), np.sin(angles)))
    origin = np.array(laser_in_base[:2])
    points: np.ndarray = origin + _ways_out(origin, beams, outline)[:, None] * beams
    return points


def _in_long_runs(flags: np.ndarray, width: float, scan: LaserScan) -> np.ndarray:
    """Return which beams' flags stand in a run that is at least `width` (rad) wide; none where that is 0."""
    increment, size, kept = abs(scan.angle_increment), len(flags), np.zeros_like(flags)
    if width <= 0.0:
        return kept
    least = min(size, math.ceil(width / increment)) if increment > 0.0 else size
    for first, count in gaps(~flags, scan.goes_round):
        kept[np.arange(first, first + count) % size] = count >= least
    return kept


def _ways_out(origin: np.ndarray, beams: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return how far (m) each beam from `origin` goes until it has left an outline for good, 0 where it never meets it.
    """
    edges = np.roll(outline, -1, axis=0) - outline
    to_corners = outline - origin
    slopes = beams[:, None, 0] * edges[:, 1] - beams[:, None, 1] * edges[:, 0]
    slopes = np.where(slopes == 0.0, np.inf, slopes)
    lengths = (to_corners[:, 0] * edges[:, 1] - to_corners[:, 1] * edges[:, 0]) / slopes
    shares = (to_corners[None, :, 0] * beams[:, None, 1] - to_corners[None, :, 1] * beams[:, None, 0]) / slopes
    met = (shares >= 0.0) & (shares <= 1.0) & (lengths > 0.0)
    farthest: np.ndarray = np.where(met, lengths, 0.0).max(axis=1, initial=0.0)
    return farthest
