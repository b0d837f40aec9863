# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled passes over a path's points: headings along them, points spread between them, points that repeat."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel


@kernel("void(float64[:,::1], float64, float64, float64, float64[:,::1])")
def to_cells(points, origin_x, origin_y, resolution, cells):
    """Convert points in metres to cells of a grid, a cell's centre lying at halves.

    Args:
        points: Shape (N, 2).
        origin_x, origin_y, resolution: Of the grid, in metres.
        cells: Shape (N, 2), filled.
    """
    for n in range(points.shape[0]):
        cells[n, 0], cells[n, 1] = (points[n, 0] - origin_x) / resolution, (points[n, 1] - origin_y) / resolution


@kernel("void(float64[:,::1], float64, float64, float64, float64[:,::1])")
def to_metres(cells, origin_x, origin_y, resolution, points):
    """Convert points in cells of a grid to metres; as `to_cells`, the other way round."""
    for n in range(cells.shape[0]):
        points[n, 0], points[n, 1] = cells[n, 0] * resolution + origin_x, cells[n, 1] * resolution + origin_y


@kernel("boolean(float64[:,::1], float64)")
def are_apart(points, least):
    """Return whether each point, (N, 2), differs from the one before by more than `least` in x or in y."""
    for n in range(1, points.shape[0]):
        if abs(points[n, 0] - points[n - 1, 0]) <= least and abs(points[n, 1] - points[n - 1, 1]) <= least:
            return False
    return True


@kernel("void(float64[:,::1], int64, float64[:,::1])")
def steps_along(points, window, steps):
    """Find the way from `window` points before each point to as many after it, as if the path stood at its ends.

    Args:
        points: Shape (N, 2), N >= 1.
        window: 1 or more.
        steps: Shape (2, N), filled with x and y.
    """
    last = points.shape[0] - 1
    for n in range(last + 1):
        before, after = max(n - window, 0), min(n + window, last)
        steps[0, n], steps[1, n] = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]


@kernel("void(float64[:,::1], float64[::1], float64, float64[:,::1])")
def head(points, directions, turned, poses):
    """Fill in poses that head where a path leads, or turned from it.

    Args:
        points: Shape (N, 2) in metres.
        directions: Shape (N,): of the path (rad).
        turned: Angle (rad) from the path's direction to the heading.
        poses: Shape (N, 3), filled; headings are in [-pi, pi).
    """
    for n in range(points.shape[0]):
        poses[n, 0], poses[n, 1] = points[n, 0], points[n, 1]
        poses[n, 2] = (directions[n] + turned + math.pi) % (2.0 * math.pi) - math.pi


@kernel("int64(float64[:,::1], float64, int64[::1])")
def split(points, spacing, parts):
    """Find into how many parts each line between two points is split so that none is longer than `spacing`.

    Args:
        points: Shape (N, 2) in metres.
        spacing: In metres.
        parts: Shape (N - 1,), filled.

    Returns:
        Their sum.
    """
    total = 0
    for n in range(parts.shape[0]):
        length = math.hypot(points[n + 1, 0] - points[n, 0], points[n + 1, 1] - points[n, 1])
        parts[n] = max(int(math.ceil(length / spacing - 1e-9)), 1)
        total += parts[n]
    return total


@kernel("void(float64[:,::1], int64[::1], float64[:,::1])")
def spread_along(points, parts, along):
    """Spread points evenly along lines.

    Args:
        points: Shape (N, 2): the lines' ends.
        parts: Shape (N - 1,): into how many parts each line is split.
        along: Shape (sum of `parts` + 1, 2), filled; its last point is that of `points`.
    """
    count = 0
    for n in range(parts.shape[0]):
        step_x, step_y = points[n + 1, 0] - points[n, 0], points[n + 1, 1] - points[n, 1]
        for part in range(parts[n]):
            share = part / parts[n]
            along[count, 0], along[count, 1] = share * step_x + points[n, 0], share * step_y + points[n, 1]
            count += 1
    last = points.shape[0] - 1
    along[count, 0], along[count, 1] = points[last, 0], points[last, 1]
