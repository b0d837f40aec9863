"""How near a drive came to what stands in its world."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.lockstep.clearance_kernels import hull_clearances
from mbf_relay.simulation.clearance import LOWER, UPPER
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import cut
from mbf_relay.simulation.world import Mover, World

HULL = np.array([UPPER, (LOWER[0], UPPER[1]), LOWER, (UPPER[0], LOWER[1])])
"""Corners (m) of the burger's outline, wheels included, around base_footprint."""

HEIGHT = 0.1
"""Height (m) above the ground at which the world is looked at: that of the robot's middle."""


def smallest_clearance(world: World, times: np.ndarray, poses: np.ndarray) -> Optional[float]:
    """Return the least distance (m) between the robot's outline and any body, None in an empty world.

    Args:
        world: What stands and moves.
        times: Seconds since the world's start, shape (N,).
        poses: The robot, shape (N, 3) as x, y, theta in metres and radians.
    """
    poses = np.ascontiguousarray(poses, dtype=float)
    clearances = np.full(len(poses), math.inf)
    fixed = np.ascontiguousarray(world.outline(HEIGHT).reshape(-1, 4))
    hull_clearances(poses, HULL, fixed, clearances)
    for mover in world.movers:
        clearances = np.minimum(clearances, _clearances_to(mover, times, poses))
    least = float(clearances.min(initial=math.inf))
    return least if math.isfinite(least) else None


def _clearances_to(mover: Mover, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the distance (m) to a mover at each time, shape (N,): the robot is looked at from the mover."""
    upright = Frame.from_pose(mover.frame_at(0.0).flat()).inverse().compose(mover.frame_at(0.0))
    outline = cut(upright.transform_points(mover.body.shape.triangles()), HEIGHT)[0].reshape(-1, 4)
    clearances = np.full(len(poses), math.inf)
    seen = [mover.frame_at(float(time)).flat().inverse().transform_poses(pose[None])[0] for time, pose in zip(times, poses)]
    hull_clearances(np.ascontiguousarray(seen).reshape(-1, 3), HULL, np.ascontiguousarray(outline), clearances)
    return clearances
