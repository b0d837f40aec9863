"""The robot's outline laid on a grid of costs."""

from __future__ import annotations

import numpy as np

from mbf_relay.costmap import footprint_kernels
from mbf_relay.costmap.cost_grid import FREE_SPACE
from mbf_relay.costmap.footprint_kernels import IN_COLLISION, ON_UNKNOWN, OUTSIDE
from mbf_relay.costmap.outline import footprint_from_radius, padded, parse_footprint, radii
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid

__all__ = [
    "IN_COLLISION", "ON_UNKNOWN", "OUTSIDE", "footprint_cells", "footprint_cost", "footprint_costs",
    "footprint_from_radius", "free_within", "padded", "parse_footprint", "radii",
]

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
    cost: float = footprint_kernels.outline_cost(
        costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(footprint, dtype=np.float64),
        pose.x, pose.y, pose.theta,
    )
    return cost


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


def free_within(grid: Grid, costs: np.ndarray, footprint: np.ndarray, pose: Pose2D) -> None:
    """Free the cells that lie wholly within a convex footprint, in costs of shape (height, width).

    Nothing but the robot can be there. A cell that the outline only crosses may hold what stands beside the robot; to
    take it for free, as costmap_2d does, blinds the robot to what it is about to touch.
    """
    if len(footprint) < 3:
        cells = footprint_cells(grid, footprint, pose)
        costs[cells[:, 1], cells[:, 0]] = FREE_SPACE
        return
    footprint_kernels.free_within(
        costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(footprint, dtype=np.float64),
        *pose)
