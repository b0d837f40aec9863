"""A scan whose beams were taken one after the other, by a sensor that turns on a robot that moves, set right."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

REACH = 1.5
"""Beams' spacings within which a direction is taken to read what the next beam does."""


def seen_at_once(scan: LaserScan, moved: Pose2D) -> LaserScan:
    """Return what the lidar would have read had it taken all beams halfway through, NaN where it then saw nothing.

    Args:
        scan: What it read, with its beams evenly spread over the time.
        moved: How it moved meanwhile.
    """
    directions, ranges = ends(scan, moved)
    return replace(scan, ranges=resampled(directions, ranges, scan.angles, REACH * abs(scan.angle_increment)))


def ends(scan: LaserScan, moved: Pose2D, seen_from: Pose2D = Pose2D(0.0, 0.0, 0.0)) -> Tuple[np.ndarray, np.ndarray]:
    """Return where beams end that were taken while the lidar moved: directions and ranges, each (B,), rad and m.

    Ranges that measure nothing (below range_min, inf, NaN) stay as they are.

    Args:
        scan: The beams.
        moved: How the lidar moved meanwhile.
        seen_from: From where, as seen from where it was halfway.
    """
    size = len(scan.ranges)
    share = (np.arange(size) + 0.5) / size - 0.5  # of the motion, of each beam
    turned = share * moved.theta
    shift = Pose2D(0.0, 0.0, -0.5 * moved.theta).compose(Pose2D(moved.x, moved.y, 0.0))
    hit = scan.hit
    reach, angles = np.where(hit, scan.ranges, scan.range_max), scan.angles + turned
    points = np.column_stack((share * shift.x + reach * np.cos(angles), share * shift.y + reach * np.sin(angles)))
    x, y = seen_from.inverse().transform_points(points).T
    return np.arctan2(y, x), np.where(hit, np.hypot(x, y), scan.ranges)


def resampled(directions: np.ndarray, ranges: np.ndarray, wanted: np.ndarray, reach: float) -> np.ndarray:
    """Return what the beams nearest to some directions read, NaN where none is near.

    Args:
        directions, ranges: Of the beams, each (B,), rad from -pi to pi and m.
        wanted: The directions (rad), shape (A,).
        reach: How near (rad) a beam must be.
    """
    order = np.argsort(directions)
    sorted_ones = directions[order]
    around = np.concatenate(([sorted_ones[-1] - 2.0 * math.pi], sorted_ones, [sorted_ones[0] + 2.0 * math.pi]))
    order = np.concatenate(([order[-1]], order, [order[0]]))
    wanted = np.mod(wanted + math.pi, 2.0 * math.pi) - math.pi
    right = np.clip(np.searchsorted(around, wanted), 1, len(around) - 1)
    nearest = np.where(wanted - around[right - 1] < around[right] - wanted, right - 1, right)
    return np.where(np.abs(around[nearest] - wanted) <= reach, ranges[order[nearest]], np.nan)
