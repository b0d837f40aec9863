"""The robot's outline: read, padded, measured, and laid on a grid of costs."""

from __future__ import annotations

import ast
import math
from typing import Any, Tuple

import numpy as np

from mbf_relay.costmap import footprint_kernels
from mbf_relay.costmap.footprint_kernels import IN_COLLISION, ON_UNKNOWN, OUTSIDE
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid

__all__ = [
    "IN_COLLISION", "ON_UNKNOWN", "OUTSIDE", "cells_within", "footprint_cells", "footprint_cost", "footprint_costs",
    "footprint_from_radius", "padded", "parse_footprint", "radii",
]

CIRCLE_CORNERS = 16
"""Corners of the polygon that stands for a round robot, as in costmap_2d."""


def parse_footprint(value: Any) -> np.ndarray:
    """Return a footprint parameter as corners, shape (K, 2) in metres; K is 0 for an empty list.

    Args:
        value: A list of [x, y] pairs, or a text that holds one, as costmap_2d takes both.

    Raises:
        ValueError: It is no such list, has one or two points, or a number that is not finite.
    """
    points = value
    if isinstance(value, str):
        try:
            points = ast.literal_eval(value.strip() or "[]")
        except (ValueError, SyntaxError) as error:
            raise ValueError(f"footprint is {value!r}; it must be a list of points [[x, y], ...]") from error
    if not isinstance(points, (list, tuple, np.ndarray)):
        raise ValueError(f"footprint is {value!r}; it must be a list of points [[x, y], ...]")
    if len(points) == 0:
        return np.zeros((0, 2))
    try:
        corners = np.array([(float(x), float(y)) for x, y in points])
    except (TypeError, ValueError) as error:
        raise ValueError(f"footprint is {value!r}; each point must be a pair of numbers [x, y]") from error
    if len(corners) < 3:
        raise ValueError(f"footprint is {value!r}; it has {len(corners)} points and must have at least 3")
    if not np.isfinite(corners).all():
        raise ValueError(f"footprint is {value!r}; every number must be finite")
    return corners


def footprint_from_radius(radius: float) -> np.ndarray:
    """Return the polygon of 16 corners that stands for a round robot, shape (16, 2) in metres."""
    if not (math.isfinite(radius) and radius >= 0.0):
        raise ValueError(f"robot_radius is {radius} m; it must be 0 or more")
    angles = np.arange(CIRCLE_CORNERS) * (2.0 * math.pi / CIRCLE_CORNERS)
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def padded(footprint: np.ndarray, padding: float) -> np.ndarray:
    """Return a footprint whose corners lie `padding` metres further out along each axis, as costmap_2d pads."""
    return footprint + np.sign(footprint) * padding


def radii(footprint: np.ndarray) -> Tuple[float, float]:
    """Return the inscribed and the circumscribed radius (m) round the base frame's origin.

    The inscribed radius is the distance to the nearest edge, the circumscribed one that to the farthest corner.
    """
    if len(footprint) < 3:
        return 0.0, 0.0
    starts, ends = footprint, np.roll(footprint, -1, axis=0)
    edges = ends - starts
    squared_lengths = np.maximum(np.einsum("ij,ij->i", edges, edges), 1e-18)
    along = np.clip(-np.einsum("ij,ij->i", starts, edges) / squared_lengths, 0.0, 1.0)
    nearest = starts + along[:, None] * edges
    return float(np.hypot(nearest[:, 0], nearest[:, 1]).min()), float(np.hypot(starts[:, 0], starts[:, 1]).max())


def footprint_cost(grid: Grid, costs: np.ndarray, footprint: np.ndarray, pose: Pose2D) -> float:
    """Return the highest cost under a footprint's outline, as costmap_2d's CostmapModel sees it.

    Args:
        grid: Where the cells lie.
        costs: Shape (height, width), uint8.
        footprint: Corners in the base frame, shape (K, 2) in metres; fewer than three stand for a point, on which
            INSCRIBED is a collision.
        pose: The base in the grid's frame.

    Returns:
        0 to 253, or IN_COLLISION, ON_UNKNOWN or OUTSIDE (all below 0).
    """
    return footprint_kernels.outline_cost(
        costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(footprint, dtype=np.float64),
        pose.x, pose.y, pose.theta,
    )


def footprint_costs(grid: Grid, costs: np.ndarray, footprint: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the `footprint_cost` of each of many poses: (N, 3) in, (N,) float64 out."""
    result = np.empty(len(poses))
    footprint_kernels.outline_costs(
        costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(footprint, dtype=np.float64),
        np.ascontiguousarray(poses, dtype=np.float64), result,
    )
    return result


def footprint_cells(grid: Grid, footprint: np.ndarray, pose: Pose2D) -> np.ndarray:
    """Return the cells a convex footprint covers, outline and inside, clipped to the grid: (N, 2) int32."""
    if len(footprint) < 3:
        cell = grid.cell_at(pose.x, pose.y)
        return np.array([cell] if grid.contains_cell(*cell) else [], dtype=np.int32).reshape(-1, 2)
    corners = grid.cells_at(pose.transform_points(footprint))
    low = np.maximum(corners.min(axis=0), 0)
    high = np.minimum(corners.max(axis=0), (grid.width - 1, grid.height - 1))
    size = np.maximum(high - low + 1, 0)
    cells = np.empty((int(size[0] * size[1]), 2), dtype=np.int32)
    if len(cells) == 0:
        return cells
    count = footprint_kernels.polygon_cells(
        grid.width, grid.height, np.ascontiguousarray(corners[:, 0]), np.ascontiguousarray(corners[:, 1]), cells
    )
    return cells[:count]


def cells_within(grid: Grid, footprint: np.ndarray, pose: Pose2D) -> np.ndarray:
    """Return the cells that lie wholly within a convex footprint: (N, 2) int32.

    Nothing but the robot can be there. A cell that the outline only crosses may hold what stands beside the robot; to
    take it for free, as costmap_2d does, blinds the robot to what it is about to touch.
    """
    if len(footprint) < 3:
        return footprint_cells(grid, footprint, pose)
    return footprint_kernels.cells_within(
        grid.width, grid.height, grid.origin_x, grid.origin_y, grid.resolution,
        np.ascontiguousarray(footprint, dtype=np.float64), pose.x, pose.y, pose.theta,
    )
