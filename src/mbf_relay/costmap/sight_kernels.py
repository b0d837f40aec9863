# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over lines of sight on a costmap.

`_LETHAL` is cost_grid's, copied because numba's cache notices changes of its own file alone; a test compares them.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254


@kernel("boolean(uint8[:,::1], float64, float64, float64, float64, float64, float64, float64)")
def _is_seen(costs, origin_x, origin_y, resolution, x, y, dx, dy):
    """Return whether the way (dx, dy) in metres from (x, y) crosses no lethal or unknown cell before the grid's edge.
    """
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
    """Mark the points whose straight line from (x, y) crosses no lethal or unknown cell; what is outside is not judged.

    Args:
        costs: Shape (H, W), uint8.
        origin_x, origin_y, resolution: Where the cells lie.
        x, y: Where from (m).
        points: Shape (N, 2) in metres.
        seen: Shape (N,): filled with 1 or 0.
    """
    for n in range(points.shape[0]):
        seen[n] = np.uint8(_is_seen(costs, origin_x, origin_y, resolution, x, y, points[n, 0] - x, points[n, 1] - y))


@kernel(
    "boolean(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], float64[:,::1], float64)")
def sees_way(costs, origin_x, origin_y, resolution, x, y, corners, poses, apart):
    """Return whether a footprint's corners are in sight from (x, y) all along a way.

    Args:
        costs, origin_x, origin_y, resolution, x, y: As for `in_sight`.
        corners: Shape (K, 2), of the footprint in the base frame (m).
        poses: Shape (N, 3): the way.
        apart: How far (m) before each corner the look at it ends.
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
