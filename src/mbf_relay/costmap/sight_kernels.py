# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over lines of sight on a costmap.

`_LETHAL` is a copy of cost_grid's: numba's cache only notices changes of the kernel's own file. A test compares them.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254


@kernel("boolean(uint8[:,::1], float64, float64, float64, float64, float64, float64, float64)")
def _is_seen(costs, origin_x, origin_y, resolution, x, y, dx, dy):
    """Return whether the line from (x, y) to (x + dx, y + dy) (m) meets no lethal or unknown cell within the grid."""
    height, width = costs.shape
    count = int(math.hypot(dx, dy) / (0.5 * resolution)) + 1
    for i in range(1, count + 1):
        column = int(math.floor((x + dx * i / count - origin_x) / resolution))
        row = int(math.floor((y + dy * i / count - origin_y) / resolution))
        if column < 0 or row < 0 or column >= width or row >= height:
            return True
        if costs[np.uint64(row), np.uint64(column)] >= _LETHAL:
            return False
    return True


@kernel("void(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], uint8[::1])")
def in_sight(costs, origin_x, origin_y, resolution, x, y, points, seen):
    """Find the points in line of sight: no lethal or unknown cell lies on the line, as far as it is within the grid.

    Args:
        costs: Shape (H, W), uint8.
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        x, y: Start of the lines (m).
        points: Shape (N, 2) in metres: their ends.
        seen: Shape (N,), filled with 1 for in sight and 0.
    """
    for n in range(points.shape[0]):
        seen[n] = np.uint8(_is_seen(costs, origin_x, origin_y, resolution, x, y, points[n, 0] - x, points[n, 1] - y))


@kernel(
    "boolean(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], float64[:,::1], float64)")
def sees_way(costs, origin_x, origin_y, resolution, x, y, corners, poses, apart):
    """Return whether a footprint's corners are in line of sight of (x, y) at all poses of a path.

    Args:
        costs, origin_x, origin_y, resolution, x, y: As for `in_sight`.
        corners: Shape (K, 2): the footprint's corners (m) in the base frame.
        poses: Shape (N, 3): the path.
        apart: Distance (m) before each corner at which the line of sight to it ends.
    """
    for n in range(poses.shape[0]):
        cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        for k in range(corners.shape[0]):
            dx = poses[n, 0] + cos * corners[k, 0] - sin * corners[k, 1] - x
            dy = poses[n, 1] + sin * corners[k, 0] + cos * corners[k, 1] - y
            short = max(0.0, 1.0 - apart / max(math.hypot(dx, dy), 1e-9))
            if not _is_seen(costs, origin_x, origin_y, resolution, x, y, short * dx, short * dy):
                return False
    return True
