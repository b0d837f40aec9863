"""The robot's outline, a polygon in the base frame: reading, padding, radii, and distances of points from it."""

from __future__ import annotations

import ast
import math
from typing import Any, List, Tuple

import numpy as np

from mbf_relay.costmap.outline_checks import first_crossing, footprint_trouble
from mbf_relay.geometry import Pose2D, convex_hull

LARGEST_ROBOT = 100.0
"""Largest coordinate (m) of a corner: outlines are followed cell by cell."""
MOST_CORNERS = 1000
"""Corners an outline may have."""
FARTHEST = 400
"""Largest distance (cells) of a corner from the base: for larger outlines too few headings could be precomputed."""
LONGEST_SHOWN = 200
"""Characters of a footprint that an error repeats."""
CIRCLE_CORNERS = 16
"""Corners of the polygon used for a round robot, as in costmap_2d."""


def parse_footprint(value: Any) -> np.ndarray:
    """Return a footprint parameter as corners, shape (K, 2) in metres; K is 0 for an empty list.

    One that crosses itself, as a rectangle with corners listed row by row, is replaced by its convex hull, which holds
    whatever was meant; costmap_2d accepts such footprints.

    Args:
        value: A list of [x, y] pairs, or a text that holds one, as costmap_2d takes both.

    Raises:
        ValueError: It is no such list, has one or two points, or numbers that are not finite or above LARGEST_ROBOT,
            encloses no area, or does not hold the base frame's origin.
    """
    corners = _corners_told(value)
    if len(corners) == 0:
        return corners
    if first_crossing(corners) is not None:
        corners = convex_hull(corners)
    trouble = footprint_trouble(corners, radii(corners)[0])
    if trouble:
        raise ValueError(f"footprint is {_shown(value)}; it {trouble}")
    return corners


def notes_on(value: Any) -> List[str]:
    """Return a note if a valid footprint parameter crosses itself and its convex hull is used instead; else nothing."""
    corners = _corners_told(value)
    if len(corners) == 0 or first_crossing(corners) is None:
        return []
    return [f"parameter footprint is {_shown(value)}; it crosses itself: the outline round its corners is used, "
            f"{convex_hull(corners).tolist()}"]


def _corners_told(value: Any) -> np.ndarray:
    """Return the corners of a footprint parameter as given, (K, 2) in metres; see `parse_footprint`."""
    points = value
    if isinstance(value, str):
        try:
            points = ast.literal_eval(value.strip() or "[]")
        except (ValueError, SyntaxError) as error:
            raise ValueError(f"footprint is {_shown(value)}; it must be a list of points [[x, y], ...]") from error
    if not isinstance(points, (list, tuple, np.ndarray)):
        raise ValueError(f"footprint is {_shown(value)}; it must be a list of points [[x, y], ...]")
    if len(points) == 0:
        return np.zeros((0, 2))
    try:
        corners = np.array([(float(x), float(y)) for x, y in points])
    except (TypeError, ValueError) as error:
        raise ValueError(f"footprint is {_shown(value)}; each point must be a pair of numbers [x, y]") from error
    if len(corners) < 3:
        raise ValueError(f"footprint is {_shown(value)}; it has {len(corners)} points and must have at least 3")
    if len(corners) > MOST_CORNERS:
        raise ValueError(f"footprint has {len(corners)} corners; at most {MOST_CORNERS} are taken")
    if not all(abs(number) <= LARGEST_ROBOT for number in corners.flat):
        raise ValueError(f"footprint is {_shown(value)}; every number must be finite and within {LARGEST_ROBOT:g} m")
    return corners


def _shown(value: Any) -> str:
    """Return a footprint's text for a log line, shortened where it is too long."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"


def check_padded(outline: np.ndarray, padding: float, resolution: float) -> None:
    """Raise ValueError where a padding (m) turns an outline, (K, 2) in metres, inside out, or makes it too large.

    Args:
        outline: Without padding, shape (K, 2) in metres.
        padding: How far (m) its corners are moved outwards.
        resolution: Side (m) of the costmap's cells.
    """
    footprint = padded(outline, padding)
    least = float(min(outline.max(axis=0).min(), -outline.min(axis=0).max()))  # of its reach to the four sides
    if -padding > max(0.0, least):
        raise ValueError(
            f"footprint_padding is {padding:g} m; it would turn a footprint inside out that reaches {least:g} m to one "
            "side of the base frame")
    reach = float(np.hypot(footprint[:, 0], footprint[:, 1]).max(initial=0.0))
    if reach > FARTHEST * resolution:
        raise ValueError(
            f"the footprint reaches {reach:.2f} m from the base frame, {reach / resolution:.0f} cells of "
            f"{resolution:g} m; at most {FARTHEST} cells can be looked at: give the costmap a coarser resolution")


def footprint_from_radius(radius: float) -> np.ndarray:
    """Return the polygon used for a round robot of a radius (m), shape (16, 2) in metres."""
    if not (math.isfinite(radius) and radius >= 0.0):
        raise ValueError(f"robot_radius is {radius} m; it must be 0 or more")
    angles = np.arange(CIRCLE_CORNERS) * (2.0 * math.pi / CIRCLE_CORNERS)
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def padded(footprint: np.ndarray, padding: float) -> np.ndarray:
    """Return a footprint whose corners lie `padding` metres further out along each axis, as costmap_2d pads."""
    corners: np.ndarray = footprint + np.sign(footprint) * padding
    return corners


def radii(footprint: np.ndarray) -> Tuple[float, float]:
    """Return the inscribed and the circumscribed radius (m) round the base frame's origin.

    The inscribed radius is the distance to the nearest edge, the circumscribed one that to the farthest corner.
    """
    if len(footprint) < 3:
        return 0.0, 0.0
    starts, ends = footprint, np.roll(footprint, -1, axis=0)
    edges = ends - starts
    squared_lengths = np.maximum(np.einsum("ij,ij->i", edges, edges), 1e-18)
    along = np.clip(-np.einsum("ij,ij->i", starts, edges) / squared_lengths, 0.0, 1.0)
    nearest = starts + along[:, None] * edges
    return float(np.hypot(nearest[:, 0], nearest[:, 1]).min()), float(np.hypot(starts[:, 0], starts[:, 1]).max())


OWN_DEPTH = 0.03
"""Depth (m) inside the outline from which on a hit is on the robot itself; nearer to the edge it may be an obstacle."""


def are_own(points: np.ndarray, base: Pose2D, outline: np.ndarray) -> np.ndarray:
    """Return which points are hits on the robot itself, such as a mast in a lidar's view: bool of shape (N,).

    Args:
        points: Shape (N, 2) or (N, 3), in metres, in any frame.
        base: Pose of the robot's base in that frame.
        outline: The robot's outline without padding, shape (K, 2) in metres, in the base frame.
    """
    reach = np.hypot(outline[:, 0], outline[:, 1]).max(initial=0.0)
    squared, y = points[:, 0] - base.x, points[:, 1] - base.y
    # squares may overflow or be NaN, of which NumPy 1.17 warns; np.hypot would be slower
    with np.errstate(over="ignore", invalid="ignore"):
        squared *= squared
        y *= y
        squared += y
        own: np.ndarray = squared < reach * reach  # False for NaN
    if own.any():
        own[own] = clearances(base.inverse().transform_points(points[own]), outline) <= -OWN_DEPTH
    return own


def clearances(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return the distance (m) of points, (N, 2), from an outline, (K, 2), negative inside: (N,); all in one frame."""
    (x, y), starts = points[:, :2].T, outline[:, :, None]  # arrays of shape (K, N): points are many, edges few
    edges = np.roll(starts, -1, axis=0) - starts
    to_x, to_y = x - starts[:, 0], y - starts[:, 1]
    squared_lengths = np.maximum(edges[:, 0] * edges[:, 0] + edges[:, 1] * edges[:, 1], 1e-18)
    along = (to_x * edges[:, 0] + to_y * edges[:, 1]) / squared_lengths
    along = np.minimum(np.maximum(along, 0.0, out=along), 1.0, out=along)
    away_x, away_y = to_x - along * edges[:, 0], to_y - along * edges[:, 1]
    distances = np.sqrt((away_x * away_x + away_y * away_y).min(axis=0))
    # A point is inside where a ray from it to the right crosses an odd number of edges.
    crosses = (to_y < 0.0) != (np.roll(starts[:, 1], -1, axis=0) > y)
    rises = np.where(edges[:, 1] == 0.0, 1.0, edges[:, 1])
    crossed_at = starts[:, 0] + to_y * edges[:, 0] / rises
    inside = (crosses & (x < crossed_at)).sum(axis=0) % 2 == 1
    return np.where(inside, -distances, distances)
