"""Scans of a lidar in a square room with discs in it, and among boxes."""

import math

import numpy as np

BEAMS, REACH = 360, 3.5


def scan(x, y, discs, rng, theta=0.0):
    """Return ends and hits of a lidar at (x, y) among discs (x, y, radius), within a square room of 5 m."""
    ways = directions(theta)
    dx, dy = ways.T
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
    return seen(x, y, ways, ranges, rng)


def scan_of_boxes(x, y, boxes, rng):
    """Return ends and hits of a lidar at (x, y) among boxes, shape (N, 4): their lower corners and their upper ones."""
    ways = directions() + 1e-12
    low, high = ((boxes[:, None, first:first + 2] - (x, y)) / ways for first in (0, 2))
    enter, leave = np.minimum(low, high).max(axis=2), np.maximum(low, high).min(axis=2)
    return seen(x, y, ways, np.where((enter <= leave) & (enter > 0.0), enter, np.inf).min(axis=0), rng)


def directions(theta=0.0):
    """Return the beams' directions, shape (BEAMS, 2)."""
    angles = theta + np.arange(BEAMS) * 2.0 * math.pi / BEAMS
    return np.column_stack((np.cos(angles), np.sin(angles)))


def seen(x, y, ways, ranges, rng):
    """Return ends and hits of beams from (x, y), noisy, to what lies at their ranges (m)."""
    hits = ranges < REACH
    ranges = np.where(hits, ranges + rng.normal(0.0, 0.01, BEAMS), REACH)
    return (x, y) + ranges[:, None] * ways, hits
