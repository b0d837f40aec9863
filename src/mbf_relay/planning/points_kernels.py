# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over a path's points: conversion to cells and back, headings, added points, repeated points."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel


@kernel("void(float64[:,::1], float64, float64, float64, float64[:,::1])")
def to_cells(points, origin_x, origin_y, resolution, cells):
    """Convert points in metres to coordinates in cells of a grid, where cells' centres lie at halves.

    Args:
        points: Shape (N, 2).
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        cells: Shape (N, 2), filled.
    """
    for n in range(points.shape[0]):
        cells[n, 0], cells[n, 1] = (points[n, 0] - origin_x) / resolution, (points[n, 1] - origin_y) / resolution


@kernel("void(float64[:,::1], float64, float64, float64, float64[:,::1])")
def to_metres(cells, origin_x, origin_y, resolution, points):
    """Convert coordinates in cells of a grid to points in metres, the inverse of `to_cells`."""
    for n in range(cells.shape[0]):
        points[n, 0], points[n, 1] = cells[n, 0] * resolution + origin_x, cells[n, 1] * resolution + origin_y


@kernel("boolean(float64[:,::1], float64)")
def are_apart(points, least):
    """Return whether each of points, (N, 2), differs from the one before by more than `least` in x or in y."""
    for n in range(1, points.shape[0]):
        if abs(points[n, 0] - points[n - 1, 0]) <= least and abs(points[n, 1] - points[n - 1, 1]) <= least:
            return False
    return True


@kernel("void(float64[:,::1], int64, float64[:,::1])")
def steps_along(points, window, steps):
    """Compute the difference between the point `window` indices after each point and that as many before it.

    Indices beyond the path's ends stand for its ends.

    Args:
        points: Shape (N, 2), N >= 1.
        window: 1 or more.
        steps: Shape (2, N), filled with the differences in x and in y.
    """
    last = points.shape[0] - 1
    for n in range(last + 1):
        before, after = max(n - window, 0), min(n + window, last)
        steps[0, n], steps[1, n] = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]


@kernel("void(float64[:,::1], float64[::1], float64, float64[:,::1])")
def head(points, directions, turned, poses):
    """Fill in poses with headings at a fixed angle from a path's directions.

    Args:
        points: Shape (N, 2) in metres.
        directions: Shape (N,): directions (rad) of the path at these points.
        turned: Angle (rad) from the path's direction to the heading.
        poses: Shape (N, 3), filled; headings are in [-pi, pi).
    """
    for n in range(points.shape[0]):
        poses[n, 0], poses[n, 1] = points[n, 0], points[n, 1]
        poses[n, 2] = (directions[n] + turned + math.pi) % (2.0 * math.pi) - math.pi


@kernel("int64(float64[:,::1], float64, int64[::1])")
def split(points, spacing, parts):
    """Compute into how many equal parts each line between two points must be split so that none exceeds `spacing`.

    Args:
        points: Shape (N, 2) in metres.
        spacing: Largest length (m) of a part.
        parts: Shape (N - 1,), filled with the numbers of parts, at least 1.

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
    """Split the lines of a path into equal parts.

    Args:
        points: Shape (N, 2): the lines' ends.
        parts: Shape (N - 1,): number of parts of each line.
        along: Shape (sum of `parts` + 1, 2), filled with the parts' ends, the last of `points` included.
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
