"""Rigid transforms in three dimensions."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, Sequence, Tuple, Union

import numpy as np

from mbf_relay.geometry import Pose2D

Triple = Union[Sequence[float], np.ndarray]
"""x, y, z."""
Quaternion = Union[Sequence[float], np.ndarray]
"""x, y, z, w; need not be normalized."""


class Frame(NamedTuple):
    """A pose in three dimensions, or a rigid transform: position (3,) in metres and rotation matrix (3, 3)."""

    position: np.ndarray
    rotation: np.ndarray

    @staticmethod
    def of(x: float, y: float, z: float = 0.0, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Frame:
        """Make a frame from a position (m) and fixed-axis angles (rad), as URDF and SDF give them."""
        return Frame(np.array([x, y, z], dtype=float), rotation_from_rpy(roll, pitch, yaw))

    @staticmethod
    def from_pose(pose: Pose2D, z: float = 0.0) -> Frame:
        """Make a frame from a pose in the plane at height `z` (m)."""
        return Frame.of(pose.x, pose.y, z, yaw=pose.theta)

    @staticmethod
    def from_quaternion(position: Triple, quaternion: Quaternion) -> Frame:
        """Make a frame from a position (m) and a quaternion (x, y, z, w), which need not be normalized."""
        return Frame(np.array(position, dtype=float), rotation_from_quaternion(quaternion))

    def compose(self, other: Frame) -> Frame:
        """Return `other`, a pose in this frame, as a pose in this frame's parent: this transform times `other`."""
        return Frame(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    def inverse(self) -> Frame:
        """Return the inverse transform."""
        return Frame(-self.rotation.T @ self.position, self.rotation.T)

    def transform_points(self, points: np.ndarray) -> np.ndarray:
        """Return points of this frame, shape (..., 3) in metres, in this frame's parent."""
        moved: np.ndarray = np.asarray(points, dtype=float) @ self.rotation.T + self.position
        return moved

    def quaternion(self) -> Tuple[float, float, float, float]:
        """Return the rotation as a unit quaternion (x, y, z, w)."""
        return _quaternion_of(np.asarray(self.rotation, dtype=float).tobytes())

    def flat(self) -> Pose2D:
        """Return the planar part: x, y (m) and yaw (rad)."""
        return Pose2D(
            float(self.position[0]), float(self.position[1]),
            math.atan2(float(self.rotation[1, 0]), float(self.rotation[0, 0])),
        )


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix of rotations about the fixed axes x, y, z, in this order (rad)."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])


def rotation_from_quaternion(quaternion: Quaternion) -> np.ndarray:
    """Return the matrix of a quaternion (x, y, z, w); raise ValueError where it is not finite or all zero."""
    x, y, z, w = (float(component) for component in quaternion)
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not math.isfinite(norm) or norm < 1e-9:
        raise ValueError(f"quaternion ({x}, {y}, {z}, {w}) is no rotation: it must be finite and not all zero")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def quaternion_product(
    one: Tuple[float, float, float, float], other: Tuple[float, float, float, float]
) -> Tuple[float, float, float, float]:
    """Return the Hamilton product `one` * `other` of unit quaternions (x, y, z, w): first rotates `other`, then `one`.
    """
    (x, y, z, w), (i, j, k, r) = one, other
    return (
        w * i + x * r + y * k - z * j, w * j - x * k + y * r + z * i, w * k + x * j - y * i + z * r,
        w * r - x * i - y * j - z * k,
    )


@lru_cache(maxsize=256)
def _quaternion_of(rotation: bytes) -> Tuple[float, float, float, float]:
    """Return quaternion_from_rotation of a matrix's bytes, cached for movers, which need it at every step."""
    return quaternion_from_rotation(np.frombuffer(rotation).reshape(3, 3))


def quaternion_from_rotation(rotation: np.ndarray) -> Tuple[float, float, float, float]:
    """Return the unit quaternion (x, y, z, w), w not negative, of a rotation matrix.

    Computed from its largest component (Shepperd's method), which is accurate for every rotation.
    """
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    candidates = np.array([r[0, 0], r[1, 1], r[2, 2], trace])
    largest = int(np.argmax(candidates))
    q = np.empty(4)
    if largest == 3:
        q[:] = (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1.0 + trace)
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1.0 - trace + 2.0 * r[i, i]
        q[j] = r[j, i] + r[i, j]
        q[k] = r[k, i] + r[i, k]
        q[3] = r[k, j] - r[j, k]
    q /= np.linalg.norm(q)
    if q[3] < 0.0:
        q = -q
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])
