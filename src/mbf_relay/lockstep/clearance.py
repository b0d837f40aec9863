"""Clearance of a drive: distances between the robot's hull and everything in the world, and time to collision."""

from __future__ import annotations

import math
from typing import NamedTuple, Optional

import numpy as np

from mbf_relay.lockstep.clearance_kernels import hull_clearances
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.robot import ROLLED_OVER, RobotModel
from mbf_relay.simulation.shapes import bounds, cut
from mbf_relay.simulation.world import Mover, World

CLOSING = 0.01
"""Closing speed (m/s) below which two bodies do not approach; the samples of a standing robot vary by less."""


class Clearances(NamedTuple):
    """Distances (m) between the robot's outline and the nearest body at each time; infinite in an empty world.

    Attributes:
        to_any: To the nearest of all bodies, shape (N,).
        to_movers: To each mover, shape (M, N).
        jumps: Whether each mover jumps from its last waypoint to its first before the next time, shape (M, N - 1).
    """

    to_any: np.ndarray
    to_movers: np.ndarray
    jumps: np.ndarray


def clearances(world: World, times: np.ndarray, poses: np.ndarray, robot: RobotModel) -> Clearances:
    """Return the robot's clearances along a trajectory.

    Args:
        world: The world with its movers.
        times: Seconds since the movers' start, shape (N,).
        poses: Poses of the robot in the world's frame, shape (N, 3) as x, y, theta in metres and radians.
        robot: The robot; bodies are cut at half its height, or in the middle of the part abreast of it where they do
            not reach there, and its outline seen from above counts.
    """
    hull = np.ascontiguousarray(robot.outline)
    poses = np.ascontiguousarray(poses, dtype=float)
    to_fixed = np.full(len(poses), math.inf)
    hull_clearances(poses, hull, _fixed_outline(world, robot.height), to_fixed)
    to_movers = np.full((len(world.movers), len(poses)), math.inf)
    jumps = np.zeros((len(world.movers), max(0, len(times) - 1)), dtype=bool)
    for row, jumped, mover in zip(to_movers, jumps, world.movers):
        row[:], jumped[:] = _clearances_to(mover, times, poses, hull, robot.height), mover.jumps(times)
    return Clearances(np.minimum(to_fixed, to_movers.min(axis=0, initial=math.inf)), to_movers, jumps)


def smallest(distances: np.ndarray) -> Optional[float]:
    """Return the smallest of some values, None where none is finite."""
    least = float(distances.min(initial=math.inf))
    return least if math.isfinite(least) else None


def smallest_time_to_collision(times: np.ndarray, distances: np.ndarray, jumps: np.ndarray) -> Optional[float]:
    """Return the smallest time to collision (s) with any mover, at the closing speed between samples.

    None where the robot and a mover never approached each other.

    Source: Hayward, "Near-miss determination through use of a scale of danger" (1972).

    Args:
        times: Shape (N,), seconds, rising.
        distances: From hull to each mover, shape (M, N) in metres.
        jumps: Whether each mover jumps between one time and the next, which is no approach, shape (M, N - 1).
    """
    seen = np.isfinite(distances).all(axis=1)
    distances = distances[seen]
    speeds = -np.diff(distances, axis=1) / np.diff(times)
    closing = (speeds > CLOSING) & ~jumps[seen]
    return smallest(distances[:, 1:][closing] / speeds[closing])


def smallest_clearance(world: World, times: np.ndarray, poses: np.ndarray, robot: RobotModel) -> Optional[float]:
    """Return the least distance (m) between the robot's outline and any body, None in an empty world.

    Args:
        world, times, poses, robot: See `clearances`.
    """
    return smallest(clearances(world, times, poses, robot).to_any)


def _fixed_outline(world: World, tall: float) -> np.ndarray:
    """Return the outline of the fixed bodies abreast of a robot `tall` metres high: segments, shape (M, 4) in metres.
    """
    triangles, owners = world.fixed_triangles()
    lowest, highest = bounds(triangles[:, :, 2])
    starts = np.flatnonzero(np.diff(owners, prepend=-1))  # each body's triangles follow one another
    low, high = np.minimum.reduceat(lowest, starts), np.maximum.reduceat(highest, starts)
    segments = [world.outline(tall / 2.0)]
    ends = np.append(starts[1:], len(triangles))
    for index in np.flatnonzero((high <= tall / 2.0) | (low > tall / 2.0)):
        segments.append(_abreast(triangles[starts[index]:ends[index]], tall))
    outline: np.ndarray = np.concatenate(segments).reshape(-1, 4)
    return outline


def _abreast(triangles: np.ndarray, tall: float) -> np.ndarray:
    """Return the outline of one body, shape (N, 3, 3), abreast of a robot `tall` metres high: (M, 2, 2) in metres."""
    low, high = max(ROLLED_OVER, triangles[:, :, 2].min()), min(tall, triangles[:, :, 2].max())
    if low >= high:
        return np.empty((0, 2, 2))
    return cut(triangles, tall / 2.0 if low <= tall / 2.0 < high else (low + high) / 2.0)[0]


def _clearances_to(
    mover: Mover, times: np.ndarray, poses: np.ndarray, hull: np.ndarray, tall: float
) -> np.ndarray:
    """Return the distance (m) to a mover at each time, shape (N,), with the robot's poses taken to the mover's frame.

    Args:
        mover: The mover.
        times, poses: The robot's trajectory, as for `clearances`.
        hull: The robot's outline, shape (K, 2) in metres, base frame.
        tall: The robot's height (m).
    """
    upright = Frame.from_pose(mover.frame_at(0.0).flat()).inverse().compose(mover.frame_at(0.0))
    outline = _abreast(upright.transform_points(mover.body.shape.triangles()), tall).reshape(-1, 4)
    distances = np.full(len(poses), math.inf)
    seen = [
        mover.frame_at(float(time)).flat().inverse().transform_poses(pose[None])[0] for time, pose in zip(times, poses)
    ]
    hull_clearances(np.ascontiguousarray(seen).reshape(-1, 3), hull, np.ascontiguousarray(outline), distances)
    return distances
