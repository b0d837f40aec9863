"""A world: its bodies and movers, the robot's start, and the goal."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Dict, List, Optional, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.simulation.frames import Frame, rotation_from_rpy
from mbf_relay.simulation.shapes import Body, Shape, cut

SCALES = (0.01, 100.0)
"""Least and largest factor by which a world can be scaled."""


def scaled_pose(pose: Pose2D, scale: float) -> Pose2D:
    """Return a pose with its position scaled."""
    return Pose2D(scale * pose.x, scale * pose.y, pose.theta)


@dataclass(frozen=True)
class Mover:
    """A body that moves along timed waypoints.

    Attributes:
        body: The body; its frame gives height and tilt, the waypoints give position and heading.
        times: Shape (W,) in seconds since the start, rising, the first at 0.
        poses: Shape (W, 3) as x, y, theta in metres and radians.
        loop: Whether it jumps to the first waypoint after the last one and starts over; else it stays at the last.
    """

    body: Body
    times: np.ndarray
    poses: np.ndarray
    loop: bool = True
    _ways: Tuple[List[float], ...] = field(init=False, repr=False, compare=False)
    _level: Frame = field(init=False, repr=False, compare=False)
    _rotation: Optional[np.ndarray] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times, dtype=float), np.asarray(self.poses, dtype=float)
        name = self.body.name
        if poses.shape != (len(times), 3) or not len(times):
            raise ValueError(
                f"mover '{name}' has {len(times)} times and poses of shape {poses.shape}; one x, y, yaw per time"
            )
        if not (np.isfinite(times).all() and np.isfinite(poses).all()):
            raise ValueError(f"mover '{name}' has waypoints that are not finite")
        if times[0] != 0.0 or (np.diff(times) <= 0.0).any():
            raise ValueError(f"mover '{name}' has times {times.tolist()}; they must start at 0 and rise")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)
        yaws = np.unwrap(poses[:, 2])
        object.__setattr__(self, "_ways", (times.tolist(), *poses[:, :2].T.tolist(), yaws.tolist()))
        object.__setattr__(self, "_level", Frame(
            np.array([0.0, 0.0, self.body.frame.position[2]]), self.body.frame.rotation))
        turns = bool((yaws != yaws[0]).any())
        object.__setattr__(self, "_rotation", None if turns else self._turned(yaws[0]))

    def frame_at(self, elapsed: float) -> Frame:
        """Return the body's frame `elapsed` seconds after the start, interpolated; it turns the shorter way."""
        period = self.times[-1]
        if self.loop and period > 0.0:
            elapsed = elapsed % period
        times, *ways = self._ways
        before = min(max(0, bisect.bisect_right(times, elapsed) - 1), max(0, len(times) - 2))
        x, y, theta = (_between(elapsed, times, way, before) for way in ways)
        rotation = self._turned(theta) if self._rotation is None else self._rotation
        return Frame(np.array([x, y, self._level.position[2]]), rotation)

    def jumps(self, times: np.ndarray) -> np.ndarray:
        """Return whether it jumps to its first waypoint between one time (s), shape (N,), and the next: (N - 1,) bool.
        """
        period = self.times[-1]
        if not self.loop or period <= 0.0 or np.allclose(self.poses[0, :2], self.poses[-1, :2]):
            return np.zeros(max(0, len(times) - 1), dtype=bool)
        made: np.ndarray = np.diff(times // period) != 0.0
        return made

    def _turned(self, yaw: float) -> np.ndarray:
        """Return the body's rotation matrix at a heading `yaw` (rad)."""
        rotation: np.ndarray = rotation_from_rpy(0.0, 0.0, yaw) @ self._level.rotation
        return rotation


def _between(time: float, times: List[float], values: List[float], before: int) -> float:
    """Return the value at a time, interpolated between indices `before` and `before` + 1; faster than np.interp."""
    if time >= times[-1]:
        return values[-1]
    slope = (values[before + 1] - values[before]) / (times[before + 1] - times[before])
    return slope * (time - times[before]) + values[before]


@dataclass(frozen=True, eq=False)
class World:
    """A world; compared and hashed by identity.

    Attributes:
        name: Name of the world.
        bodies: The bodies; the ground, a plane at z = 0, is always there and not among them.
        start: The robot's initial pose.
        movers: Bodies that follow waypoints.
        goal: The robot's goal, where the world states one.
        goal_radius: Distance (m) within which the goal counts as reached.
        reference_path_length: Length (m) of a good path, for scores.
        time_limit: Time limit (s).
        map_file: YAML file of the world's map, which may be wrong; where None, a map is drawn from the geometry.
        warnings: Lines on entries of its file that are unknown or implausible.
    """

    name: str
    bodies: Tuple[Body, ...]
    start: Pose2D = IDENTITY
    movers: Tuple[Mover, ...] = ()
    goal: Optional[Pose2D] = None
    goal_radius: float = 1.0
    reference_path_length: Optional[float] = None
    time_limit: Optional[float] = None
    warnings: Tuple[str, ...] = ()
    map_file: Optional[str] = None

    def fixed_triangles(self) -> Tuple[np.ndarray, np.ndarray]:
        """Return the surface of all fixed bodies.

        Returns:
            Triangles, shape (N, 3, 3) in metres, and the index in `bodies` of each, shape (N,); read-only.
        """
        return _fixed_triangles(self)

    def scaled(self, scale: float) -> World:
        """Return the world with lengths, and times of movers, multiplied by `scale`.

        Raises:
            ValueError: The scale is not between 0.01 and 100.
        """
        if not SCALES[0] <= scale <= SCALES[1]:
            raise ValueError(f"scale is {scale}; it must be {SCALES[0]:g} to {SCALES[1]:g}")
        movers = [
            replace(m, body=m.body.scaled(scale), times=scale * m.times, poses=m.poses * (scale, scale, 1.0))
            for m in self.movers
        ]
        return replace(
            self, bodies=tuple(body.scaled(scale) for body in self.bodies), start=scaled_pose(self.start, scale),
            movers=tuple(movers), goal=None if self.goal is None else scaled_pose(self.goal, scale),
            goal_radius=scale * self.goal_radius,
            reference_path_length=None if self.reference_path_length is None else scale * self.reference_path_length,
            time_limit=None if self.time_limit is None else max(1.0, scale) * self.time_limit,
        )

    def outline(self, height: float) -> np.ndarray:
        """Return the outline of the fixed bodies at `height` (m): segments, shape (M, 2, 2) in metres, read-only."""
        return _outline(self, height)


@lru_cache(maxsize=1)
def _fixed_triangles(world: World) -> Tuple[np.ndarray, np.ndarray]:
    """Return World.fixed_triangles, cached, as several parts of a drive need it."""
    turned: Dict[Tuple[Shape, bytes], np.ndarray] = {}  # shared by equal shapes, of which obstacle fields have hundreds
    surfaces, counts = [np.empty((0, 3, 3))], []
    fixed = [index for index, body in enumerate(world.bodies) if body.mass == 0.0]
    for index in fixed:
        shape, frame = world.bodies[index].shape, world.bodies[index].frame
        key = shape, frame.rotation.tobytes()
        if key not in turned:
            turned[key] = shape.triangles() @ frame.rotation.T
        surfaces.append(turned[key] + frame.position)
        counts.append(len(turned[key]))
    triangles, owners = np.concatenate(surfaces), np.repeat(np.array(fixed, dtype=int), np.array(counts, dtype=int))
    triangles.setflags(write=False)
    owners.setflags(write=False)
    return triangles, owners


@lru_cache(maxsize=1)
def _outline(world: World, height: float) -> np.ndarray:
    """Return World.outline, cached, as a batch drives each world with several seeds."""
    segments = cut(world.fixed_triangles()[0], height)[0]
    segments.setflags(write=False)
    return segments
