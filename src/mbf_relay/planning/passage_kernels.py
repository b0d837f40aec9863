# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop for the arc lengths and headings of a driven path."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel


@kernel("void(float64[:,::1], float64, float64[:,::1], float64[::1])")
def drive(points, reach, poses, arcs):
    """Compute the poses of a robot driving forward along a path.

    Args:
        points: Shape (N, 2) in metres, N >= 1.
        reach: Least arc length (m) before and after each point between which the heading is taken as a chord; less at
            the path's ends.
        poses: Shape (N, 3), filled.
        arcs: Shape (N,), filled with the arc length (m) of each point.
    """
    count = points.shape[0]
    arcs[0] = 0.0
    for n in range(1, count):
        arcs[n] = arcs[n - 1] + math.hypot(points[n, 0] - points[n - 1, 0], points[n, 1] - points[n - 1, 1])
    behind, ahead = 0, 0
    for n in range(count):
        while behind + 1 < n and arcs[behind + 1] <= arcs[n] - reach:
            behind += 1
        while ahead + 1 < count and arcs[ahead] < arcs[n] + reach:
            ahead += 1
        poses[n, 0], poses[n, 1] = points[n, 0], points[n, 1]
        poses[n, 2] = math.atan2(points[ahead, 1] - points[behind, 1], points[ahead, 0] - points[behind, 0])
