"""Scans of a lidar in a square room with discs in it."""

import math

import numpy as np

BEAMS, REACH = 360, 3.5


def scan(x, y, discs, rng, theta=0.0):
    """Return ends and hits of a lidar at (x, y) among discs (x, y, radius), within a square room of 5 m."""
    angles = theta + np.arange(BEAMS) * 2.0 * math.pi / BEAMS
    dx, dy = np.cos(angles), np.sin(angles)
    walls = [
        (np.where(way > 0, 2.5, -2.5) - at) / np.where(np.abs(way) < 1e-9, 1e-9, way) for way, at in ((dx, x), (dy, y))
    ]
    ranges = np.abs(walls).min(axis=0)
    for cx, cy, radius in discs:
        along = (cx - x) * dx + (cy - y) * dy
        inside = along ** 2 - (cx - x) ** 2 - (cy - y) ** 2 + radius ** 2
        ranges = np.minimum(
            ranges, np.where((inside > 0) & (along > 0), along - np.sqrt(np.maximum(0, inside)), np.inf)
        )
    hits = ranges < REACH
    ranges = np.where(hits, ranges + rng.normal(0.0, 0.01, BEAMS), REACH)
    return np.column_stack((x + ranges * dx, y + ranges * dy)), hits
