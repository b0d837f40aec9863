"""Whether there is room for the robot somewhere, told from triangles alone."""

from __future__ import annotations

from typing import Optional, Sequence

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.robot import RobotModel
from mbf_relay.simulation.shapes import bounds, cut

HAIR = 1e-6
"""Metres by which rounding may move a point, and more."""


def obstruction(
    triangles: np.ndarray, owners: np.ndarray, pose: Pose2D, robot: RobotModel, halls: Sequence[int] = (),
) -> Optional[int]:
    """Return whose surface the robot would cut, or whose inside it would stand in, None where there is room.

    Args:
        triangles: Closed surfaces, shape (N, 3, 3) in metres.
        owners: Shape (N,): whose each triangle is.
        pose: Of base_footprint.
        robot: Who needs room.
        halls: Owners whose surfaces may be seen from within, as a building's is.
    """
    inverse = pose.inverse()
    near = _abreast(triangles, inverse, robot.outline)
    triangles, owners = triangles[near], owners[near]
    for height in robot.heights():
        segments, indices = cut(triangles, height)
        if not len(segments):
            continue
        local = inverse.transform_points(segments.reshape(-1, 2)).reshape(-1, 2, 2)
        hit = _crosses_outline(local, robot.outline)
        if hit.any():
            return int(owners[indices[np.argmax(hit)]])
        crossings = np.bincount(owners[indices[crosses_positive_x_axis(local)]])
        inside = np.setdiff1d(np.flatnonzero(crossings % 2), halls)
        if len(inside):
            return int(inside[0])
    return None


def surface_obstructs(triangles: np.ndarray, pose: Pose2D, robot: RobotModel) -> bool:
    """Return whether one closed surface, shape (N, 3, 3) in metres, leaves no room for the robot at `pose`."""
    return obstruction(triangles, np.zeros(len(triangles), dtype=int), pose, robot) is not None


def _abreast(triangles: np.ndarray, inverse: Pose2D, outline: np.ndarray) -> np.ndarray:
    """Return which triangles lie as far aside as the outline or the x axis: no others meet it, or the ray along x.

    Args:
        triangles: Shape (N, 3, 3) in metres.
        inverse: Of the robot's pose.
        outline: Of the robot, shape (K, 2) in metres.
    """
    aside = inverse.transform_points(triangles[:, :, :2].reshape(-1, 2))[:, 1].reshape(-1, 3)
    lowest, highest = bounds(aside)
    right, left = min(0.0, outline[:, 1].min()) - HAIR, max(0.0, outline[:, 1].max()) + HAIR
    abreast: np.ndarray = (lowest <= left) & (highest >= right)
    return abreast


def _crosses_outline(segments: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Tell which segments (M, 2, 2) have a point in a convex polygon (K, 2), counter-clockwise; shape (M,) bool.

    A segment enters and leaves the half planes left of the edges; M. Cyrus, J. Beck, "Generalized two- and
    three-dimensional clipping", 1978.
    """
    edges = np.roll(outline, -1, axis=0) - outline
    outward = np.column_stack((edges[:, 1], -edges[:, 0]))
    beyond = segments[:, 0] @ outward.T - (outline * outward).sum(axis=1)
    rate = (segments[:, 1] - segments[:, 0]) @ outward.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -beyond / rate
    enter = np.where(rate < 0.0, crossing, np.where((rate == 0.0) & (beyond > 0.0), np.inf, -np.inf)).max(axis=1)
    leave = np.where(rate > 0.0, crossing, np.inf).min(axis=1)
    crossed: np.ndarray = (enter <= leave) & (leave >= 0.0) & (enter <= 1.0)
    return crossed


def crosses_positive_x_axis(segments: np.ndarray) -> np.ndarray:
    """Tell which segments (M, 2, 2) a ray from the origin along +x crosses, shape (M,) bool."""
    (x1, y1), (x2, y2) = segments[:, 0].T, segments[:, 1].T
    spans = (y1 > 0.0) != (y2 > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed: np.ndarray = spans & (x1 - y1 * (x2 - x1) / (y2 - y1) > 0.0)
        return crossed
