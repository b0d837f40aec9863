# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over paths: thinning, and the nearest point of a polyline for many points at once."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_STRETCH = 8  # pieces of a path that are passed over together


@kernel("void(float64[:,::1], float64, uint8[::1])")
def thin(points, spacing, keep):
    """Mark the points of a path that lie at least `spacing` from the last one marked, and the final one.

    Args:
        points: Shape (N, 2) in metres, N >= 1.
        spacing: Metres.
        keep: Shape (N,), filled with 0 and 1; points that repeat the final one are not kept besides it.
    """
    last = points.shape[0] - 1
    keep[:] = 0
    keep[0] = 1
    kept = 0
    for index in range(1, points.shape[0]):
        if math.hypot(points[index, 0] - points[kept, 0], points[index, 1] - points[kept, 1]) >= spacing:
            keep[index] = 1
            kept = index
    if kept == last:
        return
    if kept > 0 or (points[0, 0] == points[last, 0] and points[0, 1] == points[last, 1]):
        keep[kept] = 0
    keep[last] = 1


@kernel("void(float64[:,::1], float64[:,::1])")
def round_stretches(line, circles):
    """Write a circle round each _STRETCH pieces of a polyline: centre and radius (m), a hair more than needed."""
    count = line.shape[0] - 1
    for stretch in range(circles.shape[0]):
        first, last = stretch * _STRETCH, min(count, (stretch + 1) * _STRETCH)
        x = 0.5 * (line[first, 0] + line[last, 0])
        y = 0.5 * (line[first, 1] + line[last, 1])
        radius = 0.0
        for corner in range(first, last + 1):
            radius = max(radius, math.hypot(line[corner, 0] - x, line[corner, 1] - y))
        circles[stretch, 0], circles[stretch, 1], circles[stretch, 2] = x, y, radius + 1e-6


@kernel("UniTuple(float64, 2)(float64, float64, float64[:,::1], float64[:,::1], int64)")
def _nearest_on(x, y, line, ways, corner):
    """Return the squared distance (m^2) of a point from the piece that begins at a corner, and how far along it."""
    dx, dy = ways[corner, 0], ways[corner, 1]
    px = x - line[corner, 0]
    py = y - line[corner, 1]
    along = (px * dx + py * dy) * ways[corner, 2]
    along = 0.0 if along < 0.0 else (1.0 if along > 1.0 else along)
    px -= along * dx
    py -= along * dy
    return px * px + py * py, along


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], float64[:,::1])")
def project(points, line, arcs, result):
    """Find the nearest point of a polyline for each point.

    Stretches of the line that cannot hold it, for they lie in a circle farther away than what is known to be near,
    are passed over.

    Args:
        points: Shape (M, 2) in metres; those that follow each other best lie near each other.
        line: Shape (K, 2) in metres, K >= 2.
        arcs: Shape (K,): arc length (m) at each corner of the line.
        result: Shape (M, 2): filled with the distance (m) and the arc length (m) of the nearest point; of several, the
            first along the line.
    """
    count = line.shape[0] - 1
    # from each corner to the next, and one over the squared length: no division in the loop
    ways = np.empty((count, 3))
    for corner in range(count):
        dx = line[corner + 1, 0] - line[corner, 0]
        dy = line[corner + 1, 1] - line[corner, 1]
        length = dx * dx + dy * dy
        ways[corner, 0], ways[corner, 1] = dx, dy
        ways[corner, 2] = 1.0 / length if length > 0.0 else 0.0
    circles = np.empty(((count + _STRETCH - 1) // _STRETCH, 3))
    round_stretches(line, circles)
    nearest_corner = 0
    for index in range(points.shape[0]):
        x, y = points[index, 0], points[index, 1]
        guess = math.sqrt(_nearest_on(x, y, line, ways, nearest_corner)[0])
        nearest, nearest_along = 1e300, 0.0
        for stretch in range(circles.shape[0]):
            px = x - circles[stretch, 0]
            py = y - circles[stretch, 1]
            reach = guess + circles[stretch, 2]
            if px * px + py * py > reach * reach:
                continue
            for corner in range(stretch * _STRETCH, min(count, (stretch + 1) * _STRETCH)):
                distance, along = _nearest_on(x, y, line, ways, corner)
                if distance < nearest:
                    nearest, nearest_corner, nearest_along = distance, corner, along
            guess = min(guess, math.sqrt(nearest))
        result[index, 0] = math.sqrt(nearest)
        result[index, 1] = arcs[nearest_corner] + nearest_along * (arcs[nearest_corner + 1] - arcs[nearest_corner])
