"""Scan matching: aligns a scan with the one before, lest errors of odometry look like motion of objects."""

from __future__ import annotations

import math
from typing import NamedTuple, Optional

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angle
from mbf_relay.tracking import tracker_kernels
from mbf_relay.tracking.clusters import Rays

NOISE = 0.02
"""Standard deviation (m) of a reading's distance from its wall."""
GATES = np.array((0.5, 0.25, 0.12, 0.12))
"""Largest distance (m) between a reading and its wall in each Gauss-Newton step."""
TURNED = 0.1
"""Factor (rad/m): heading error of odometry per metre driven is `share` times this."""
FEWEST = 3
"""Least number of rays of scans that are matched."""
LEAST = 1e-4
"""Standard deviation (m, rad) of odometry at standstill; so small that people walking past do not move the scan."""


class Walls(NamedTuple):
    """The reference scan for matching the next one.

    Attributes:
        x, y: Position of the sensor (m).
        heading: Heading of the sensor (rad).
        directions, points, solid: See `tracker_kernels.normal_equations`.
    """

    x: float
    y: float
    heading: float
    directions: np.ndarray
    points: np.ndarray
    solid: np.ndarray


def walls_of(rays: Rays, heading: float, order: np.ndarray, moving: np.ndarray) -> Walls:
    """Return a scan as a reference, without moving objects.

    Args:
        rays: The scan.
        heading: Heading of the sensor (rad).
        order: Indices that sort the bearings, shape (N,).
        moving: Which rays hit a moving object, shape (N,), bool.
    """
    return Walls(
        rays.x, rays.y, heading, rays.bearings[order],
        np.ascontiguousarray(rays.ends[order]), (rays.hits & ~moving)[order])


def odometry_correction(
    before: Walls, x: float, y: float, heading: float, ends: np.ndarray, hits: np.ndarray, share: float
) -> Optional[Pose2D]:
    """Return the transform that corrects a scan's pose by odometry, from matching it with the scan before.

    None where the scans are too small or the robot stands. Minimizes point-to-line distances, with odometry as a prior
    whose standard deviation is proportional to the motion; Censi, "An ICP variant using a point-to-line metric" (2008),
    for the metric.

    Args:
        before: The scan before.
        x, y, ends, hits: The scan, placed by odometry; see `Rays`. The number of rays may differ.
        heading: Heading of the sensor by odometry (rad).
        share: Standard deviation of odometry relative to the motion between the scans.
    """
    if len(before.directions) < FEWEST or len(ends) < FEWEST:
        return None
    moved = math.hypot(x - before.x, y - before.y)
    turned = abs(normalize_angle(heading - before.heading))
    if moved < LEAST and turned < LEAST:
        return None
    wrong = share * moved + LEAST, share * moved + LEAST, share * (turned + TURNED * moved) + LEAST
    motion = np.empty(3)
    tracker_kernels.match_scan(
        before.x, before.y, before.directions, before.points, before.solid, x, y, ends, hits, 1.0 / np.square(wrong),
        GATES, NOISE, motion)
    dx, dy, turn = motion.tolist()
    return Pose2D(x + dx, y + dy, turn).compose(Pose2D(x, y, 0.0).inverse())
