"""Planar poses, velocities and angles, shared by the whole package."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any, List, NamedTuple

import numpy as np

FASTEST = 1000.0
"""Largest speed (m/s or rad/s) that is plausible for a robot."""
FARTHEST = 1e7
"""Largest coordinate (m) that is plausible; UTM has northings up to this."""

FULL_TURN = 6.3
"""Magnitude (rad) above which a heading is probably in degrees."""


def normalize_angle(angle: float) -> float:
    """Return `angle` (rad) wrapped to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def normalize_angles(angles: np.ndarray) -> np.ndarray:
    """Return an array of angles (rad) wrapped to [-pi, pi)."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def angle_between(start: float, end: float) -> float:
    """Return the signed shortest turn (rad) that leads from `start` to `end`."""
    return normalize_angle(end - start)


def degrees_told(yaw: float) -> str:
    """Return the end of a warning where a yaw (rad) is probably in degrees; empty otherwise."""
    if abs(yaw) <= FULL_TURN:
        return ""
    return f"is {yaw:g} rad; if degrees are meant, write {math.radians(yaw):.4f}"


class Pose2D(NamedTuple):
    """A pose in the plane, equally a rigid transform: x and y in metres, theta in radians.

    A pose `b_in_a` is the transform that takes points given in frame b to frame a.
    """

    x: float
    y: float
    theta: float

    def compose(self, other: Pose2D) -> Pose2D:
        """Return `other`, given in this pose's frame, in the frame this pose is given in."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return Pose2D(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            normalize_angle(self.theta + other.theta),
        )

    def inverse(self) -> Pose2D:
        """Return the inverse transform."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return Pose2D(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, normalize_angle(-self.theta))

    def relative_to(self, reference: Pose2D) -> Pose2D:
        """Return this pose in the frame of `reference`, both given in one frame."""
        return reference.inverse().compose(self)

    def distance_to(self, other: Pose2D) -> float:
        """Return the distance (m) between the two positions."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def is_apart(self, other: Pose2D, distance: float, angle: float) -> bool:
        """Return whether the other lies farther than `distance` (m) away or is turned by more than `angle` (rad)."""
        return self.distance_to(other) > distance or abs(angle_between(self.theta, other.theta)) > angle

    def is_finite(self) -> bool:
        """Return whether no coordinate is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.theta)

    def transform_points(self, points: np.ndarray) -> np.ndarray:
        """Take points of this pose's frame, shape (N, 2) in metres, to the frame this pose is given in."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        rotation = np.array([[cos, -sin], [sin, cos]])
        moved: np.ndarray = np.asarray(points, dtype=float)[:, :2] @ rotation.T + (self.x, self.y)
        return moved

    def transform_poses(self, poses: np.ndarray) -> np.ndarray:
        """Take poses of this pose's frame, shape (N, 3) as x, y, theta, to the frame this pose is given in."""
        poses = np.asarray(poses, dtype=float)
        return np.column_stack((self.transform_points(poses), normalize_angles(poses[:, 2] + self.theta)))


IDENTITY = Pose2D(0.0, 0.0, 0.0)


class Twist2D(NamedTuple):
    """A velocity in the body frame: x and y in m/s, theta in rad/s."""

    x: float
    y: float
    theta: float

    @staticmethod
    def of(values: Any) -> Twist2D:
        """Return a tuple, list or array of three numbers as a velocity of Python floats.

        Raises:
            TypeError: They are anything else.
        """
        parts = tuple(values) if isinstance(values, (tuple, list, np.ndarray)) else ()
        if len(parts) != 3 or not all(isinstance(part, Real) for part in parts):
            raise TypeError(f"{values!r} is no velocity, which is three numbers: x, y, theta")
        return Twist2D(*map(float, parts))

    def is_finite(self) -> bool:
        """Return whether no component is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.theta)

    def is_a_robots(self) -> bool:
        """Return whether the velocity is plausible for a robot: no component is NaN or beyond FASTEST."""
        return all(abs(part) <= FASTEST for part in self)

    def speed(self) -> float:
        """Return the translational speed (m/s)."""
        return math.hypot(self.x, self.y)

    def scaled(self, factor: float) -> Twist2D:
        """Return the velocity times a factor; it leads along the same arc."""
        return Twist2D(factor * self.x, factor * self.y, factor * self.theta)

    def held(self, duration: float) -> Pose2D:
        """Return the pose reached from the origin at this velocity after `duration` (s); theta is not wrapped."""
        turn = self.theta * duration
        if abs(self.theta) < 1e-9:
            return Pose2D(self.x * duration, self.y * duration, turn)
        sine, versine = math.sin(turn) / self.theta, (1.0 - math.cos(turn)) / self.theta
        return Pose2D(self.x * sine - self.y * versine, self.x * versine + self.y * sine, turn)


STOP = Twist2D(0.0, 0.0, 0.0)


def polygon_area(corners: np.ndarray) -> float:
    """Return the area (m^2) of a simple polygon with corners (m) of shape (K, 2)."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points (N, 2), counter-clockwise, shape (K, 2).

    By the monotone chain, A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", 1979.

    Raises:
        ValueError: There are fewer than three distinct points.
    """
    ordered = np.unique(np.round(points, 6), axis=0)
    if len(ordered) < 3:
        raise ValueError(f"{len(ordered)} points make no outline")

    def chain(sequence: np.ndarray) -> List[np.ndarray]:
        kept: List[np.ndarray] = []
        for point in sequence:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], point) <= 1e-12:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Return twice the signed area of a triangle, positive where a, b, c are counter-clockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
