"""The robot's outline as a polygon: read, padded, measured, and its distance from points."""

from __future__ import annotations

import ast
import math
from typing import Any, List, Tuple

import numpy as np

from mbf_relay.costmap.outline_checks import first_crossing, footprint_trouble
from mbf_relay.geometry import Pose2D, convex_hull

LARGEST_ROBOT = 100.0
"""Metres from the base frame to a corner; an outline is followed cell by cell."""
MOST_CORNERS = 1000
"""Corners of an outline."""
FARTHEST = 400
"""Cells from the base frame to a corner: of outlines larger than that, too few headings could be drawn beforehand."""
LONGEST_SHOWN = 200
"""Characters of an outline that a refusal repeats."""
CIRCLE_CORNERS = 16
"""Corners of the polygon that stands for a round robot, as in costmap_2d."""


def parse_footprint(value: Any) -> np.ndarray:
    """Return a footprint parameter as corners, shape (K, 2) in metres; K is 0 for an empty list.

    Of one that crosses itself, as a rectangle does whose corners are listed row by row, it is the outline round them
    all: costmap_2d drives such robots, and this holds all that the corners can mean.

    Args:
        value: A list of [x, y] pairs, or a text that holds one, as costmap_2d takes both.

    Raises:
        ValueError: It is no such list, has one or two points, a number that is not finite, or no robot can have it.
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
    """Return what was made of a footprint parameter that can be read, one line each; none where it is as it stands."""
    corners = _corners_told(value)
    if len(corners) == 0 or first_crossing(corners) is None:
        return []
    return [f"parameter footprint is {_shown(value)}; it crosses itself: the outline round its corners is used, "
            f"{convex_hull(corners).tolist()}"]


def _corners_told(value: Any) -> np.ndarray:
    """Return the corners of a footprint parameter in the order they are told; see `parse_footprint`."""
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
    """Return a footprint as a line of a log bears it."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"


def check_padded(outline: np.ndarray, padding: float, resolution: float) -> None:
    """Raise ValueError where a padding (m) turns an outline, (K, 2) in metres, inside out, or makes it too large.

    Args:
        outline: Without padding, shape (K, 2) in metres.
        padding: How far (m) its corners are moved outwards.
        resolution: Side (m) of the cells it is looked at in.
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
    """Return the polygon of 16 corners that stands for a round robot, shape (16, 2) in metres."""
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
"""Metres inside of the footprint from which on a reading is the robot's own; nearer to its edge it may be a contact."""


def are_own(points: np.ndarray, base: Pose2D, outline: np.ndarray) -> np.ndarray:
    """Return which points are of the robot itself: bool of shape (N,).

    A mast or pillars in a lidar's view are no obstacles, and do not move about the robot, but with it.

    Args:
        points: Shape (N, 2) or more, in metres, as seen from some frame.
        base: The robot in that frame.
        outline: Its own, shape (K, 2) in metres, in its frame.
    """
    reach = np.hypot(outline[:, 0], outline[:, 1]).max(initial=0.0)
    squared, y = points[:, 0] - base.x, points[:, 1] - base.y
    # of what is as far away as no number tells, or none, which NumPy 1.17 warns of; hypot would take its time for it
    with np.errstate(over="ignore", invalid="ignore"):
        squared *= squared
        y *= y
        squared += y
        own: np.ndarray = squared < reach * reach  # False for what is no number
    if own.any():
        own[own] = clearances(base.inverse().transform_points(points[own]), outline) <= -OWN_DEPTH
    return own


def clearances(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return how far each point lies from an outline, below zero for points inside of it: (N, 2) in, (N,) metres out.
    """
    (x, y), starts = points[:, :2].T, outline[:, :, None]  # an edge a row, for points are many
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
