"""A scan whose beams were taken one after the other, by a sensor that turns on a robot that moves, set right."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.scan import LaserScan

REACH = 1.5
"""Beams' spacings within which a direction is taken to read what the next beam does."""


class Order(NamedTuple):
    """The order in which a lidar takes its beams.

    Attributes:
        way: 1 where the next one follows, -1 where the one before does, 0 where all are taken at once.
        start: Share of the scan at which the sensor begins to look round: drivers that sort beams by their angles may
            have that in the middle.
    """

    way: int
    start: float

    def __str__(self) -> str:
        return _IN_WORDS[self]

    def shares(self, beams: int) -> np.ndarray:
        """Return when each of so many beams is taken, shape (B,), as shares of the time from -0.5 to 0.5."""
        along: np.ndarray = np.mod((np.arange(beams) + 0.5) / beams - self.start, 1.0) - 0.5
        return self.way * along


AT_ONCE, FORWARDS, BACKWARDS = Order(0, 0.0), Order(1, 0.0), Order(-1, 0.0)
ORDERS = (AT_ONCE, FORWARDS, BACKWARDS, Order(1, 0.5), Order(-1, 0.5))
"""Those there are: of lidars that look all round, the one or the other half first."""
_IN_WORDS = dict(zip(ORDERS, (
    "all at once", "the first one first", "the last one first", "from the middle one on", "from the middle one back")))


def seen_at_once(scan: LaserScan, order: Order, moved: Pose2D) -> LaserScan:
    """Return what the lidar would have read had it taken all beams halfway through, NaN where it then saw nothing.

    Args:
        scan: What it read, with its beams evenly spread over the time.
        order: In which it took them.
        moved: How it moved meanwhile.
    """
    directions, ranges = ends(scan, order, moved)
    return replace(scan, ranges=resampled(directions, ranges, scan.angles, REACH * abs(scan.angle_increment)))


def ends(
    scan: LaserScan, order: Order, moved: Pose2D, seen_from: Pose2D = IDENTITY
) -> Tuple[np.ndarray, np.ndarray]:
    """Return where beams end that were taken while the lidar moved: directions and ranges, each (B,), rad and m.

    Ranges that measure nothing (below range_min, inf, NaN) stay as they are.

    Args:
        scan: The beams.
        order: In which they were taken.
        moved: How the lidar moved meanwhile.
        seen_from: From where, as seen from where it was halfway.
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
