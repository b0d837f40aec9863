"""Whether there is room for the robot somewhere, told from triangles alone."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation import burger
from mbf_relay.simulation.shapes import cut

HEIGHTS = (0.005, 0.03, 0.06, 0.10, 0.14, 0.18)
"""Heights (m) at which the robot's outline is compared with the world's."""

REAR = burger.CASTER_CENTER[0] - burger.CASTER_SIZE[0] / 2.0
FRONT = burger.BODY_CENTER[0] + burger.BODY_SIZE[0] / 2.0
SIDE = (burger.WHEEL_SEPARATION + burger.WHEEL_WIDTH) / 2.0
LOWER = np.array([min(REAR, burger.BODY_CENTER[0] - burger.BODY_SIZE[0] / 2.0), -SIDE])
UPPER = np.array([FRONT, SIDE])
"""Corners (m) of the robot's outline in base_footprint."""


def obstruction(triangles: np.ndarray, owners: np.ndarray, pose: Pose2D) -> Optional[int]:
    """Return whose surface the robot would cut, or whose inside it would stand in, None where there is room.

    Args:
        triangles: Closed surfaces, shape (N, 3, 3) in metres.
        owners: Shape (N,): whose each triangle is.
        pose: Of base_footprint.
    """
    inverse = pose.inverse()
    for height in HEIGHTS:
        segments, indices = cut(triangles, height)
        if not len(segments):
            continue
        local = inverse.transform_points(segments.reshape(-1, 2)).reshape(-1, 2, 2)
        hit = _crosses_box(local, LOWER, UPPER)
        if hit.any():
            return int(owners[indices[np.argmax(hit)]])
        crossings = np.bincount(owners[indices[_crosses_positive_x_axis(local)]])
        inside = np.flatnonzero(crossings % 2)
        if len(inside):
            return int(inside[0])
    return None


def surface_obstructs(triangles: np.ndarray, pose: Pose2D) -> bool:
    """Tell whether one closed surface, shape (N, 3, 3) in metres, leaves no room for the robot at `pose`."""
    return obstruction(triangles, np.zeros(len(triangles), dtype=int), pose) is not None


def _crosses_box(segments: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Tell which segments (M, 2, 2) have a point in a box, by the slab method; shape (M,) bool."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (lower - start) / way, (upper - start) / way
    still = way == 0.0
    within = (start >= lower) & (start <= upper)
    enter = np.where(still, np.where(within, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leave = np.where(still, np.where(within, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return (enter <= leave) & (leave >= 0.0) & (enter <= 1.0)


def _crosses_positive_x_axis(segments: np.ndarray) -> np.ndarray:
    """Tell which segments (M, 2, 2) a ray from the origin along +x crosses, shape (M,) bool."""
    (x1, y1), (x2, y2) = segments[:, 0].T, segments[:, 1].T
    spans = (y1 > 0.0) != (y2 > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return spans & (x1 - y1 * (x2 - x1) / (y2 - y1) > 0.0)
