"""How near a drive came to what stands in its world."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.lockstep.clearance_kernels import hull_clearances
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import slice_segments
from mbf_relay.simulation.world import Mover, World

HULL = np.array([[0.038, 0.089], [-0.102, 0.089], [-0.102, -0.089], [0.038, -0.089]])
"""Outline (m) of the burger seen from above, wheels included, around base_footprint."""

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
    outline = np.ascontiguousarray(mover_outline(mover).reshape(-1, 4))
    clearances = np.full(len(poses), math.inf)
    seen = np.array([mover.pose_at(float(time)).inverse().transform_poses(pose[None])[0] for time, pose in zip(times, poses)])
    hull_clearances(np.ascontiguousarray(seen), HULL, outline, clearances)
    return clearances


def mover_outline(mover: Mover) -> np.ndarray:
    """Return what a plane at HEIGHT cuts of a mover, in the frame that its waypoints move: shape (M, 2, 2) in metres."""
    body = mover.body
    upright = Frame.from_pose(body.frame.flat()).inverse().compose(body.frame)
    return slice_segments(upright.transform_points(body.shape.triangles()), HEIGHT)
