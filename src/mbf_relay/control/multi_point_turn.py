"""Multi-point turns of a car: Reeds-Shepp curves to poses on its path, checked for collision."""

from __future__ import annotations

import math
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.reeds_shepp import LEFT, RIGHT, STRAIGHT, Curve, Word, curves
from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

# in minimum turning radii of the car
EASIER = 1.1  # radius it is planned with, which leaves some steering to correct errors
APART = 0.5  # spacing of the target poses on the path
FARTHEST = 4.0  # distance of the last target along the path
CUSP = 0.6  # cost of a change between forwards and backwards

MOST = 80  # curves checked for collision, cheapest first
FEWER = 3  # every third target only, the last among them, where a first move is tried
FIRST_MOVES: List[Word] = [
    [(turn, sign * length)] for length in (0.5, 1.0, 1.5) for sign in (1.0, -1.0) for turn in (LEFT, STRAIGHT, RIGHT)]


def multi_point_turn(
    pose: Pose2D, path: LocalPath, checker: FootprintChecker, radius: float, reverses: bool
) -> Optional[Way]:
    """Return the cheapest free way to the path, by its length, changes of direction and the path left; None for none.

    Where no curve from the car's pose is free, curves are tried after each of FIRST_MOVES.

    Args:
        pose: The car's pose, in the costmap's frame.
        path: The path it follows.
        checker: The obstacles.
        radius: Minimum turning radius (m).
        reverses: Whether it can drive backwards.
    """
    targets, depths = _targets(path, radius), checker.depths_at(pose)
    for first_moves, places in (([[]], targets), (FIRST_MOVES, targets[::-FEWER])):
        found: List[Tuple[float, Curve]] = []
        for move in first_moves:
            begun = Curve(move, EASIER * radius)
            if move and _free_way(begun.poses(pose, 2.0 * checker.step), depths, checker, radius) is None:
                continue
            begin = Pose2D(*begun.poses(pose, math.inf)[-1].tolist())
            for arc, place in places:
                for rest in curves(begin, place, EASIER * radius):
                    whole = rest._replace(word=move + rest.word)
                    curve = whole if reverses else whole.forwards()
                    if curve is not None:
                        found.append((curve.length + CUSP * radius * curve.cusps + path.goal_arc - arc, curve))
        found.sort(key=lambda one: one[0])
        for _cost, curve in found[:MOST]:
            way = _free_way(curve.poses(pose, 2.0 * checker.step), depths, checker, radius)
            if way is not None:
                return way
    return None


def _free_way(poses: np.ndarray, depths: np.ndarray, checker: FootprintChecker, radius: float) -> Optional[Way]:
    """Return the way through poses, (S, 3), if it is free, apart from what the car touches already; else None.

    Args:
        poses: The first is the car's.
        depths: Shape (2,): overlap (cells) of its footprint there; see FootprintChecker.depths_at.
        checker, radius: As for multi_point_turn.
    """
    if depths[0] < 0.0 and checker.touches(poses).any():
        return None
    allowed = np.full((len(poses), 2), -1.0)
    allowed[0] = depths
    way = Way(poses, allowed, checker.costmap.width, radius)
    return way if way.free_poses(checker) == len(poses) else None


def _targets(path: LocalPath, radius: float) -> List[Tuple[float, Pose2D]]:
    """Return (arc length in m, pose) of targets ahead: points of the path in its direction, and the goal if near."""
    apart, farthest = APART * radius, path.robot_arc + FARTHEST * radius
    known = min(path.goal_arc, float(path.arcs[-1]) - apart)
    targets = []
    for arc in np.arange(path.robot_arc + apart, min(farthest, known), apart).tolist():
        (x, y), (x1, y1) = path.point_at(arc).tolist(), path.point_at(min(arc + apart, path.goal_arc)).tolist()
        targets.append((arc, Pose2D(x, y, math.atan2(y1 - y, x1 - x))))
    if path.goal_arc <= farthest:
        targets.append((path.goal_arc, path.goal))
    return targets
