"""Motion compensation (deskewing) of scans whose beams are taken one after the other by a spinning lidar."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.scan import LaserScan

REACH = 1.5
"""Largest distance, in beam spacings, of a direction from the beam whose range it gets."""


class Order(NamedTuple):
    """The order in which a lidar takes its beams.

    Attributes:
        way: 1 for increasing indices, -1 for decreasing ones, 0 for all at once.
        start: Share of the scan, 0 to 1, at which the sweep begins: in the middle with some drivers, which sort beams
            by angle.
    """

    way: int
    start: float

    def __str__(self) -> str:
        return _IN_WORDS[self]

    def shares(self, beams: int) -> np.ndarray:
        """Return the times of `beams` beams as shares of the sweep time, from -0.5 to 0.5, shape (B,)."""
        along: np.ndarray = np.mod((np.arange(beams) + 0.5) / beams - self.start, 1.0) - 0.5
        return self.way * along


AT_ONCE, FORWARDS, BACKWARDS = Order(0, 0.0), Order(1, 0.0), Order(-1, 0.0)
ORDERS = (AT_ONCE, FORWARDS, BACKWARDS, Order(1, 0.5), Order(-1, 0.5))
"""The orders that are distinguished; with start 0.5, lidars of a full turn that begin in the middle of the scan."""
_IN_WORDS = dict(zip(ORDERS, (
    "all at once", "the first one first", "the last one first", "from the middle one on", "from the middle one back")))


def seen_at_once(scan: LaserScan, order: Order, moved: Pose2D) -> LaserScan:
    """Return the scan as if all beams had been taken at the middle of the sweep, NaN in directions without a beam.

    Args:
        scan: The scan, with beams evenly spread over the sweep time.
        order: Order of the beams.
        moved: Motion of the lidar during the sweep, in its frame at the start.
    """
    directions, ranges = ends(scan, order, moved)
    return replace(scan, ranges=resampled(directions, ranges, scan.angles, REACH * abs(scan.angle_increment)))


def ends(
    scan: LaserScan, order: Order, moved: Pose2D, seen_from: Pose2D = IDENTITY
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the motion-compensated ends of the beams: directions (rad) and ranges (m), shape (B,) each.

    Ranges without a return (below range_min, range_max or more, NaN) stay as they are.

    Args:
        scan: The scan.
        order: Order of the beams.
        moved: Motion of the lidar during the sweep, in its frame at the start.
        seen_from: Pose that the ends are given from, in the lidar's frame at the middle of the sweep.
    """
    share = order.shares(len(scan.ranges))  # of the motion
    turned = share * moved.theta
    shift = Pose2D(0.0, 0.0, -0.5 * moved.theta).compose(Pose2D(moved.x, moved.y, 0.0))
    hit = scan.hit
    reach, angles = np.where(hit, scan.ranges, scan.range_max), scan.angles + turned
    points = np.column_stack((share * shift.x + reach * np.cos(angles), share * shift.y + reach * np.sin(angles)))
    x, y = seen_from.inverse().transform_points(points).T
    return np.arctan2(y, x), np.where(hit, np.hypot(x, y), scan.ranges)


def resampled(directions: np.ndarray, ranges: np.ndarray, wanted: np.ndarray, reach: float) -> np.ndarray:
    """Return the ranges (m) of the beams nearest to some directions, shape (A,), NaN where none is near.

    Args:
        directions, ranges: Of the beams, each (B,), rad from -pi to pi and m.
        wanted: The directions (rad), shape (A,).
        reach: Largest difference (rad) in direction.
    """
    order = np.argsort(directions)
    sorted_ones = directions[order]
    around = np.concatenate(([sorted_ones[-1] - 2.0 * math.pi], sorted_ones, [sorted_ones[0] + 2.0 * math.pi]))
    order = np.concatenate(([order[-1]], order, [order[0]]))
    wanted = np.mod(wanted + math.pi, 2.0 * math.pi) - math.pi
    right = np.clip(np.searchsorted(around, wanted), 1, len(around) - 1)
    nearest = np.where(wanted - around[right - 1] < around[right] - wanted, right - 1, right)
    return np.where(np.abs(around[nearest] - wanted) <= reach, ranges[order[nearest]], np.nan)
