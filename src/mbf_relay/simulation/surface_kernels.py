# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels for ray casting at triangles in a grid."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

EDGE = 1e-9
"""Tolerance in barycentric coordinates, so that no ray passes between two adjacent triangles."""


@kernel("float64(float64[::1], float64, float64, float64, float64, float64, float64)")
def share_to_triangle(
    corner_and_edges: np.ndarray, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> float:
    """Return the fraction of a ray at which it hits a triangle, above 1 beyond its end, +inf where it misses.

    Moeller, Trumbore: Fast, minimum storage ray/triangle intersection (1997), for both sides of the triangle.

    Args:
        corner_and_edges: A corner and the two edges from it, shape (9,) in metres.
        x, y, z: Start of the ray (m).
        dx, dy, dz: Vector from its start to its end (m).
    """
    ax, ay, az = corner_and_edges[3], corner_and_edges[4], corner_and_edges[5]
    bx, by, bz = corner_and_edges[6], corner_and_edges[7], corner_and_edges[8]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    size = ax * px + ay * py + az * pz
    if size == 0.0:
        return math.inf
    sx, sy, sz = x - corner_and_edges[0], y - corner_and_edges[1], z - corner_and_edges[2]
    u = (sx * px + sy * py + sz * pz) / size
    if u < -EDGE or u > 1.0 + EDGE:
        return math.inf
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) / size
    if v < -EDGE or u + v > 1.0 + EDGE:
        return math.inf
    share = (bx * qx + by * qy + bz * qz) / size
    return share if share >= 0.0 else math.inf


@kernel(
    "void(float64[::1], float64[:,::1], float64[:,::1], int64[::1], int64[::1], float64[::1], int64, int64, "
    "float64[::1])"
)
def cast(
    start: np.ndarray, ends: np.ndarray, triangles: np.ndarray, first: np.ndarray, members: np.ndarray,
    frame: np.ndarray, columns: int, rows: int, shares: np.ndarray,
) -> None:
    """Cast rays: each traverses the grid's cells, seen from above, until it hits a triangle.

    Amanatides, Woo: A fast voxel traversal algorithm for ray tracing (1987), in two dimensions. As triangles extend
    over several cells, a hit counts as the first only if it lies before the next cell.

    Args:
        start: Start of all rays, shape (3,) in metres.
        ends: Their ends, shape (B, 3) in metres.
        triangles: A corner and two edges of each, shape (N, 9) in metres.
        first: Offset in `members` of each cell's triangles, row by row, shape (columns * rows + 1,).
        members: Indices of triangles, by cell.
        frame: x, y of the grid's lower left corner and the cells' side, shape (3,) in metres.
        columns, rows: Number of cells.
        shares: Fraction of each ray before its first hit, 1 where it hits nothing, shape (B,); filled in place.
    """
    side = frame[2]
    x, y, z = start[0], start[1], start[2]
    x0, y0 = (x - frame[0]) / side, (y - frame[1]) / side
    for ray in range(len(ends)):
        dx, dy, dz = ends[ray, 0] - x, ends[ray, 1] - y, ends[ray, 2] - z
        shares[ray] = 1.0
        enter, leave = 0.0, 1.0
        for axis in range(2):
            at, step, count = (x0, dx / side, columns) if axis == 0 else (y0, dy / side, rows)
            if step == 0.0:
                if at < 0.0 or at >= count:
                    leave = -1.0
                continue
            one, two = -at / step, (count - at) / step
            enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
        if enter > leave:
            continue
        column = min(columns - 1, max(0, int(x0 + enter * dx / side)))
        row = min(rows - 1, max(0, int(y0 + enter * dy / side)))
        right, up = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # Fractions of the ray at which the next column and row begin, and per column and row.
        per_column = abs(side / dx) if dx != 0.0 else math.inf
        per_row = abs(side / dy) if dy != 0.0 else math.inf
        next_column = (column + (1 if dx > 0.0 else 0) - x0) * side / dx if dx != 0.0 else math.inf
        next_row = (row + (1 if dy > 0.0 else 0) - y0) * side / dy if dy != 0.0 else math.inf
        best = 1.0
        while 0 <= column < columns and 0 <= row < rows:
            cell = row * columns + column
            for place in range(first[cell], first[cell + 1]):
                best = min(best, share_to_triangle(triangles[members[place]], x, y, z, dx, dy, dz))
            if best <= min(next_column, next_row):
                break
            if next_column < next_row:
                column += right
                next_column += per_column
            else:
                row += up
                next_row += per_row
        shares[ray] = best
