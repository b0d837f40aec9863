# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled kernels that compare two paths; see path_hysteresis."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("int64(float64[::1], float64, float64)")
def _count(arcs, length, spacing):
    """Return the number of points that `_spread` fills: of the first `length` (m), about `spacing` (m) apart."""
    return max(2, int(math.ceil(min(length, arcs[-1]) / spacing)) + 1)


@kernel("void(float64[:,::1], float64[::1], float64, float64[:,::1])")
def _spread(path, arcs, length, points):
    """Sample a path's first `length` (m) at equal distances.

    Args:
        path: Poses, shape (N, 3).
        arcs: Arc length (m) to each pose, shape (N,).
        length: Metres from the path's beginning.
        points: Output, shape (K, 2).
    """
    end = min(length, arcs[-1])
    count = points.shape[0]
    step = end / (count - 1)
    index, last = 0, arcs.shape[0] - 1
    for n in range(count):
        wanted = end if n == count - 1 else n * step
        while index < last and arcs[index + 1] <= wanted:
            index += 1
        share = 0.0
        if index < last:
            share = (wanted - arcs[index]) / (arcs[index + 1] - arcs[index])
        after = min(index + 1, last)
        points[n, 0] = path[index, 0] + share * (path[after, 0] - path[index, 0])
        points[n, 1] = path[index, 1] + share * (path[after, 1] - path[index, 1])


@kernel("boolean(float64[:,::1], float64[:,::1], float64)")
def _stay_near(points, others, width):
    """Return whether each of some points, (K, 2), has one of the others, (L, 2), within `width` (m)."""
    squared = width * width
    near = 0  # start at the last match: along two similar paths the next point is usually close to it
    for n in range(points.shape[0]):
        found = False
        for offset in range(others.shape[0]):
            index = (near + offset) % others.shape[0]
            across, up = points[n, 0] - others[index, 0], points[n, 1] - others[index, 1]
            if across * across + up * up <= squared:
                near, found = index, True
                break
        if not found:
            return False
    return True


@kernel("boolean(float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64, float64, float64)")
def _begins_near(path, arcs, other, other_arcs, ahead, spacing, width):
    """Return whether a path's first `ahead` metres stay within `width` of twice as much of another one."""
    points = np.empty((_count(arcs, ahead, spacing), 2))
    _spread(path, arcs, ahead, points)
    others = np.empty((_count(other_arcs, 2.0 * ahead, spacing), 2))
    _spread(other, other_arcs, 2.0 * ahead, others)
    return _stay_near(points, others, width)


@kernel("boolean(float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64, float64, float64)")
def is_same_way(old, old_arcs, new, new_arcs, ahead, spacing, width):
    """Return whether two paths stay within `width` (m) of each other.

    The first `ahead` metres of each must lie within `width` of the first 2 `ahead` metres of the other.

    Args:
        old, new: Poses, shape (N, 3) and (M, 3).
        old_arcs, new_arcs: Arc length (m) to each pose, shape (N,) and (M,).
        ahead: Length (m) that is compared.
        spacing: Distance (m) between compared points.
        width: Largest distance (m).
    """
    return _begins_near(old, old_arcs, new, new_arcs, ahead, spacing, width) and _begins_near(
        new, new_arcs, old, old_arcs, ahead, spacing, width)
