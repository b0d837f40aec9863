"""Possible obstacles where a lidar measured nothing: nearer than range_min, or before beams that failed."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import gaps


def blind_points(scan: LaserScan, laser_in_base: Pose2D, width: float, outline: np.ndarray) -> np.ndarray:
    """Return assumed obstacle points for runs of beams without a measurement, shape (N, 2) in metres in the base frame.

    An obstacle nearer than range_min looks like a failed beam, and its distance is unknown; so a point is assumed where
    each such beam leaves the footprint.

    Args:
        scan: Scan with angles counterclockwise as seen from above.
        laser_in_base: Pose of the lidar in the base frame.
        width: Least angle (rad) of a run of neighbouring beams; 0 for none. Beams of minus infinity count always.
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
    """Return which beams belong to a run of flags at least `width` (rad) wide; none where that is 0."""
    increment, size, kept = abs(scan.angle_increment), len(flags), np.zeros_like(flags)
    if width <= 0.0:
        return kept
    least = min(size, math.ceil(width / increment)) if increment > 0.0 else size
    for first, count in gaps(~flags, scan.goes_round):
        kept[np.arange(first, first + count) % size] = count >= least
    return kept


def _ways_out(origin: np.ndarray, beams: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return the distance (m) from `origin` to where each beam last leaves an outline; 0 where it never crosses it."""
    edges = np.roll(outline, -1, axis=0) - outline
    to_corners = outline - origin
    slopes = beams[:, None, 0] * edges[:, 1] - beams[:, None, 1] * edges[:, 0]
    slopes = np.where(slopes == 0.0, np.inf, slopes)
    lengths = (to_corners[:, 0] * edges[:, 1] - to_corners[:, 1] * edges[:, 0]) / slopes
    shares = (to_corners[None, :, 0] * beams[:, None, 1] - to_corners[None, :, 1] * beams[:, None, 0]) / slopes
    met = (shares >= 0.0) & (shares <= 1.0) & (lengths > 0.0)
    farthest: np.ndarray = np.where(met, lengths, 0.0).max(axis=1, initial=0.0)
    return farthest
