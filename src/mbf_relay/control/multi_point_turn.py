"""Turning a car round in several moves: on to where its path leads, in the direction in which that leads there."""

from __future__ import annotations

import math
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.control import reeds_shepp
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

# in radii of the car's smallest circle
EASIER = 1.1  # the circle it is planned with, which leaves it something to steer errors out with
APART = 0.5  # between the places on the path that it may be turned to
FARTHEST = 4.0  # of them along the path
CUSP = 0.6  # way that a change of direction counts as

MOST = 80  # ways looked at for obstacles


def multi_point_turn(
    pose: Pose2D, path: LocalPath, checker: FootprintChecker, radius: float, reverses: bool
) -> Optional[Way]:
    """Return the free way that is shortest, with what is left of the path from its end on; None where none is free.

    Args:
        pose: Where the car is.
        path: It is to follow.
        checker: The obstacles.
        radius: Of its smallest circle (m).
        reverses: Whether it can drive backwards.
    """
    found: List[Tuple[float, reeds_shepp.Curve]] = []
    for arc, target in _targets(path, radius):
        for one in reeds_shepp.curves(pose, target, EASIER * radius):
            way = one if reverses else one.forwards()
            if way is not None:
                found.append((way.length + CUSP * radius * way.cusps + path.goal_arc - arc, way))
    width, begin = checker.costmap.width, checker.depths_at(pose)
    for _cost, way in sorted(found, key=lambda one: one[0])[:MOST]:
        poses = way.poses(pose, 2.0 * checker.step)
        if begin[0] < 0.0 and checker.touches(poses).any():
            continue
        depths = np.full((len(poses), 2), -1.0)
        depths[0] = begin
        driven = Way(poses, depths, width, radius)
        if driven.free_poses(checker) == len(poses):
            return driven
    return None


def _targets(path: LocalPath, radius: float) -> List[Tuple[float, Pose2D]]:
    """Return places ahead on the path, by how far along it they lie (m), each in its direction there, and the goal."""
    ahead = path.robot_arc + radius * np.arange(APART, FARTHEST + 0.5 * APART, APART)
    targets = []
    for arc in ahead[ahead < path.goal_arc]:
        (x, y), (x1, y1) = path.point_at(arc), path.point_at(min(arc + APART * radius, path.goal_arc))
        targets.append((float(arc), Pose2D(float(x), float(y), math.atan2(y1 - y, x1 - x))))
    if len(targets) < len(ahead):
        targets.append((path.goal_arc, path.goal))
    return targets
