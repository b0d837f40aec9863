# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled look at a path as it is driven: arc lengths and headings."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel


@kernel("void(float64[:,::1], float64, float64[:,::1], float64[::1])")
def drive(points, reach, poses, arcs):
    """Find the poses of a robot driven forward along a path.

    Args:
        points: Shape (N, 2) in metres, N >= 1.
        reach: How far (m) the chord whose direction the robot has goes at least to either side along the path, where
            the path goes on.
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
