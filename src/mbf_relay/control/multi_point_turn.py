"""Turning a car round in several moves: on to where its path leads, in the direction in which that leads there."""

from __future__ import annotations

import math
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.reeds_shepp import LEFT, RIGHT, STRAIGHT, Curve, Word, curves
from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

# in radii of the car's smallest circle
EASIER = 1.1  # the circle it is planned with, which leaves it something to steer errors out with
APART = 0.5  # between the places on the path that it may be turned to
FARTHEST = 4.0  # of them along the path
CUSP = 0.6  # way that a change of direction counts as

MOST = 80  # ways looked at for obstacles
FEWER = 3  # of so many places on the path one, the last among them, where other moves come first
FIRST_MOVES: List[Word] = [
    [(turn, sign * length)] for length in (0.5, 1.0, 1.5) for sign in (1.0, -1.0) for turn in (LEFT, STRAIGHT, RIGHT)]


def multi_point_turn(
    pose: Pose2D, path: LocalPath, checker: FootprintChecker, radius: float, reverses: bool
) -> Optional[Way]:
    """Return the free way that is shortest, with what is left of the path from its end on; None where none is free.

    Where no way is free from where the car is, those are looked at that begin with another move.

    Args:
        pose: Where the car is.
        path: It is to follow.
        checker: The obstacles.
        radius: Of its smallest circle (m).
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
    """Return the way through poses, (S, 3), where it is free but for what the car touches already; else None.

    Args:
        poses: The first is the car's.
        depths: Shape (2,): how deep (cells) its footprint lies in marks there; see FootprintChecker.
        checker, radius: As for multi_point_turn.
    """
    if depths[0] < 0.0 and checker.touches(poses).any():
        return None
    allowed = np.full((len(poses), 2), -1.0)
    allowed[0] = depths
    way = Way(poses, allowed, checker.costmap.width, radius)
    return way if way.free_poses(checker) == len(poses) else None


def _targets(path: LocalPath, radius: float) -> List[Tuple[float, Pose2D]]:
    """Return places ahead on the path, by how far along it they lie (m), each in its direction there, and the goal."""
    apart, farthest = APART * radius, path.robot_arc + FARTHEST * radius
    known = min(path.goal_arc, float(path.arcs[-1]) - apart)
    targets = []
    for arc in np.arange(path.robot_arc + apart, min(farthest, known), apart).tolist():
        (x, y), (x1, y1) = path.point_at(arc).tolist(), path.point_at(min(arc + apart, path.goal_arc)).tolist()
        targets.append((arc, Pose2D(x, y, math.atan2(y1 - y, x1 - x))))
    if path.goal_arc <= farthest:
        targets.append((path.goal_arc, path.goal))
    return targets
