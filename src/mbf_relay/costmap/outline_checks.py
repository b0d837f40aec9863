"""Checks whether a polygon can be the outline of a robot."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.geometry import polygon_area

LEAST_AREA = 1e-6
"""Area (m²) below which the corners count as lying on a line."""
ON_OUTLINE = 1e-9
"""Distance (m) from an outline within which a point counts as on it."""


def footprint_trouble(corners: np.ndarray, inscribed: float) -> str:
    """Return what is wrong with a footprint, as the end of an error's text; empty if a robot can have it.

    The inscribed radius is measured from the base frame's origin, which therefore must lie within the footprint.

    Args:
        corners: Shape (K, 2) in metres; the polygon must not cross itself.
        inscribed: Its inscribed radius (m).
    """
    if polygon_area(corners) < LEAST_AREA:
        return "encloses no area: its corners lie on a line"
    if inscribed > ON_OUTLINE and not _holds_origin(corners):
        return "does not hold the base frame's origin, round which the robot turns"
    return ""


def _holds_origin(corners: np.ndarray) -> bool:
    """Return whether the origin is inside of an outline, (K, 2): its edges then turn around it once."""
    x, y = np.ascontiguousarray(corners.T)
    angles = np.arctan2(y, x)
    turns = np.diff(np.append(angles, angles[0]))
    turns = (turns + math.pi) % math.tau - math.pi
    return bool(abs(turns.sum()) > math.pi)


def first_crossing(corners: np.ndarray) -> Optional[Tuple[int, int]]:
    """Return the indices of two edges of a polygon, (K, 2), that cross between their ends; None for none."""
    ends = np.roll(corners, -1, axis=0)
    starts_aside = _sides(corners, ends, corners)  # [i, j]: side of edge i on which corner j lies
    ends_aside = np.roll(starts_aside, -1, axis=1)
    parts = starts_aside * ends_aside < 0.0  # [i, j]: the line of edge i separates the ends of edge j
    crossings = np.argwhere(np.triu(parts & parts.T))
    return (int(crossings[0][0]), int(crossings[0][1])) if len(crossings) else None


def _sides(starts: np.ndarray, ends: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return on which side of each line, shapes (K, 2), each point, shape (N, 2), lies: shape (K, N), 0 on the line."""
    along = ends - starts
    off = points[None, :, :] - starts[:, None, :]
    sides: np.ndarray = np.sign(along[:, None, 0] * off[:, :, 1] - along[:, None, 1] * off[:, :, 0])
    return sides
