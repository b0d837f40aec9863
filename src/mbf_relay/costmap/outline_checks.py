"""Whether an outline is one that a robot can have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbf_relay.costmap.outline import radii

LEAST_AREA = 1e-6
"""Square metres below which corners lie on a line: what they stand for would fit anywhere."""


def footprint_trouble(corners: np.ndarray) -> str:
    """Return what is wrong with a footprint (K, 2), empty for one that a robot can have.

    costmap_2d takes its inner radius for that of a circle round the base frame: where the frame lies outside, the robot
    would be taken for one that fits nowhere or everywhere.
    """
    crossing = _first_crossing(corners)
    if crossing is not None:
        first, second = crossing
        return f"crosses itself: the edge from corner {first} meets that from corner {second}"
    if _area(corners) < LEAST_AREA:
        return "encloses no area: its corners lie on a line"
    if not _holds_origin(corners):
        return "does not hold the base frame's origin, round which the robot turns"
    return ""


def _area(corners: np.ndarray) -> float:
    """Return the area (m^2) of an outline that does not cross itself."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def _holds_origin(corners: np.ndarray) -> bool:
    """Return whether the origin is inside or on the outline: its edges go round it once."""
    x, y = np.ascontiguousarray(corners.T)
    angles = np.arctan2(y, x)
    turns = np.diff(np.append(angles, angles[0]))
    turns = (turns + math.pi) % math.tau - math.pi
    return abs(turns.sum()) > math.pi or radii(corners)[0] < 1e-9


def _first_crossing(corners: np.ndarray) -> Any:
    """Return the indices of two edges that cross in their inside, None where none do."""
    ends = np.roll(corners, -1, axis=0)
    count = len(corners)
    for first in range(count):
        for second in range(first + 2, count):
            if first == 0 and second == count - 1:
                continue  # neighbours
            if _cross(corners[first], ends[first], corners[second], ends[second]):
                return first, second
    return None


def _cross(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Return whether the segments a-b and c-d cross in their inside; all of shape (2,)."""
    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0
