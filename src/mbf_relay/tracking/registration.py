"""A scan laid on the one before it: what odometry has wrong between them is no motion of what stands."""

from __future__ import annotations

import math
from typing import NamedTuple, Optional

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angle
from mbf_relay.tracking import tracker_kernels
from mbf_relay.tracking.clusters import Rays

NOISE = 0.02
"""Deviation (m) of a reading from the wall it is of."""
GATES = np.array((0.5, 0.25, 0.12, 0.12))
"""Metres beyond which a reading is of something else, for one step of Gauss and Newton after the other."""
TURNED = 0.1
"""Radians that odometry turns wrongly on a metre, as a multiple of its error's share."""
FEWEST = 3
"""Rays of a scan that can be laid on another."""
LEAST = 1e-4
"""Deviation (m, rad) of odometry that stands: it does not turn a scan round who walks past a robot that waits."""


class Walls(NamedTuple):
    """A scan as the next one is laid on it.

    Attributes:
        x, y: Where it was taken (m).
        heading: Which way the sensor faced (rad).
        directions, points, solid: See `tracker_kernels.pull`.
    """

    x: float
    y: float
    heading: float
    directions: np.ndarray
    points: np.ndarray
    solid: np.ndarray


def walls_of(rays: Rays, heading: float, order: np.ndarray, moving: np.ndarray) -> Walls:
    """Return a scan without what moves in it; `order`, which sorts its bearings, and `moving` of shape (N,)."""
    return Walls(
        rays.x, rays.y, heading, rays.bearings[order],
        np.ascontiguousarray(rays.ends[order]), (rays.hits & ~moving)[order])


def misplaced(
    before: Walls, x: float, y: float, heading: float, ends: np.ndarray, hits: np.ndarray, share: float
) -> Optional[Pose2D]:
    """Return what takes a scan from where odometry has it to where the one before says it was; None where nothing does.

    By the least squares of its readings' distances to the lines of the other, with what odometry says as a prior that
    is as wide as it has moved: Gutmann, Weiss, Censi, "An ICP variant using a point-to-line metric" (2008), for the
    lines.

    Args:
        before: The scan before.
        x, y, ends, hits: The scan, where odometry has it; see `Rays`. It need not have as many rays as the other.
        heading: Which way the sensor faced (rad), likewise.
        share: Of its motion between the two by which odometry may be wrong.
    """
    if len(before.directions) < FEWEST or len(ends) < FEWEST:
        return None
    moved = math.hypot(x - before.x, y - before.y)
    turned = abs(normalize_angle(heading - before.heading))
    if moved < LEAST and turned < LEAST:
        return None
    wrong = share * moved + LEAST, share * moved + LEAST, share * (turned + TURNED * moved) + LEAST
    motion = np.empty(3)
    tracker_kernels.lay(
        before.x, before.y, before.directions, before.points, before.solid, x, y, ends, hits, 1.0 / np.square(wrong),
        GATES, NOISE, motion)
    dx, dy, turn = motion.tolist()
    return Pose2D(x + dx, y + dy, turn).compose(Pose2D(x, y, 0.0).inverse())
