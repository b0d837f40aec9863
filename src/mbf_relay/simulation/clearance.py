"""Tests whether the robot fits at a pose, by triangles alone and without the physics engine."""

from __future__ import annotations

from typing import Optional, Sequence

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.robot import RobotModel
from mbf_relay.simulation.shapes import bounds, cut

HAIR = 1e-6
"""Tolerance (m) for rounding errors of coordinates."""


def obstruction(
    triangles: np.ndarray, owners: np.ndarray, pose: Pose2D, robot: RobotModel, halls: Sequence[int] = (),
) -> Optional[int]:
    """Return the owner of a surface that the robot would intersect, or stand inside of; None where there is room.

    The surfaces are cut at several heights of the robot and compared with its outline.

    Args:
        triangles: Closed surfaces, shape (N, 3, 3) in metres.
        owners: Index of the body that each triangle belongs to, shape (N,).
        pose: Pose of base_footprint in the world.
        robot: The robot, with its outline and heights.
        halls: Owners that the robot may be inside of, as buildings.
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
    """Return which triangles overlap the outline or the x axis in the robot's y coordinate, shape (N,) bool.

    No others can meet the outline, or the ray along +x by which `obstruction` finds out what the robot is inside of.

    Args:
        triangles: Shape (N, 3, 3) in metres.
        inverse: Inverse of the robot's pose.
        outline: The robot's outline, shape (K, 2) in metres.
    """
    aside = inverse.transform_points(triangles[:, :, :2].reshape(-1, 2))[:, 1].reshape(-1, 3)
    lowest, highest = bounds(aside)
    right, left = min(0.0, outline[:, 1].min()) - HAIR, max(0.0, outline[:, 1].max()) + HAIR
    abreast: np.ndarray = (lowest <= left) & (highest >= right)
    return abreast


def _crosses_outline(segments: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return which segments (M, 2, 2) intersect a convex polygon (K, 2), counter-clockwise, or lie in it: (M,) bool.

    Cyrus-Beck clipping: M. Cyrus, J. Beck, "Generalized two- and three-dimensional clipping", 1978.
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
    """Return which segments (M, 2, 2) cross the ray from the origin along +x, shape (M,) bool."""
    (x1, y1), (x2, y2) = segments[:, 0].T, segments[:, 1].T
    spans = (y1 > 0.0) != (y2 > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed: np.ndarray = spans & (x1 - y1 * (x2 - x1) / (y2 - y1) > 0.0)
        return crossed
