# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels for distances between the robot's hull and line segments."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("float64(float64, float64, float64, float64, float64, float64)")
def squared_to_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance of a point p to the segment from a to b."""
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    share = 0.0
    if squared > 0.0:
        share = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / squared))
    dx, dy = px - ax - share * dx, py - ay - share * dy
    return dx * dx + dy * dy


@kernel("boolean(float64, float64, float64, float64, float64, float64, float64, float64)")
def cross(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> bool:
    """Return whether the segments a-b and c-d intersect, other than at an end."""
    one = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    two = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    three = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    four = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return one * two < 0.0 and three * four < 0.0


@kernel("void(float64[:,::1], float64[:,::1], float64[:,::1], float64[::1])")
def hull_clearances(poses: np.ndarray, hull: np.ndarray, segments: np.ndarray, clearances: np.ndarray) -> None:
    """Lower `clearances` to the distance between the hull and the nearest segment, 0 where they cross.

    Args:
        poses: Shape (N, 3) as x, y, theta in metres and radians, in the frame of the segments.
        hull: Corners of the outline around the base, shape (K, 2) in metres.
        segments: Shape (M, 4) as x, y of both ends in metres.
        clearances: Shape (N,), metres; filled in place.
    """
    corners = np.empty_like(hull)
    radius = 0.0
    for k in range(len(hull)):
        radius = max(radius, math.hypot(hull[k, 0], hull[k, 1]))
    middles = np.empty((len(segments), 3))  # bounding circle of each segment: centre x, y and radius, a bit enlarged
    for m in range(len(segments)):
        ax, ay, bx, by = segments[m, 0], segments[m, 1], segments[m, 2], segments[m, 3]
        middles[m, 0], middles[m, 1] = 0.5 * (ax + bx), 0.5 * (ay + by)
        middles[m, 2] = 0.5 * math.hypot(bx - ax, by - ay) + 1e-6
    nearest = -1
    for n in range(len(poses)):
        x, y, theta = poses[n, 0], poses[n, 1], poses[n, 2]
        cos, sin = math.cos(theta), math.sin(theta)
        for k in range(len(hull)):
            corners[k, 0] = x + cos * hull[k, 0] - sin * hull[k, 1]
            corners[k, 1] = y + sin * hull[k, 0] + cos * hull[k, 1]
        least = clearances[n]
        for place in range(-1, len(segments)):
            m = nearest if place < 0 else place  # first the segment nearest to the pose before; it bounds the search
            if m < 0:
                continue
            reach = least + radius
            dx, dy, far = middles[m, 0] - x, middles[m, 1] - y, reach + middles[m, 2]
            if dx * dx + dy * dy > far * far:  # a cheap test that skips most segments
                continue
            ax, ay, bx, by = segments[m, 0], segments[m, 1], segments[m, 2], segments[m, 3]
            if squared_to_segment(x, y, ax, ay, bx, by) >= reach * reach:
                continue
            last, before = len(hull) - 1, least
            for k in range(len(hull)):
                cx, cy, dx, dy = corners[last, 0], corners[last, 1], corners[k, 0], corners[k, 1]
                if cross(ax, ay, bx, by, cx, cy, dx, dy):
                    least = 0.0
                squared = squared_to_segment(cx, cy, ax, ay, bx, by)
                squared = min(squared, squared_to_segment(ax, ay, cx, cy, dx, dy))
                squared = min(squared, squared_to_segment(bx, by, cx, cy, dx, dy))
                least = min(least, math.sqrt(squared))
                last = k
            if least < before:
                nearest = m
        clearances[n] = least
