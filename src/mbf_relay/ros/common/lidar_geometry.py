"""The mounting of a lidar on the robot: its pose in the base frame, upside down or tilted, and its scans by that."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from typing import NamedTuple, Optional, Tuple

import numpy as np
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage, shown
from mbf_relay.ros.common.clouds import rigid
from mbf_relay.ros.common.conversions import scan_from_message
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan

LEAST_LEVEL = 0.5
"""Cosine of the largest tilt of a lidar (60 degrees): beyond, most beams meet floor and ceiling."""
LEVEL = 0.9994
"""Cosine of the tilt (2 degrees) up to which ranges are not corrected: that is less than a millimetre in a metre."""


class MountedScan(NamedTuple):
    """A scan with its lidar's pose.

    Attributes:
        scan: The scan, with angles counter-clockwise seen from above, about the pose's direction.
        laser_in_base: The lidar's pose in the base frame.
        is_fixed: Whether that is known by /tf_static alone, so that it never changes.
    """

    scan: LaserScan
    laser_in_base: Pose2D
    is_fixed: bool


def scan_in_base(
    message: LaserScanMessage, base_frame: str, transforms: Transforms, max_age: Optional[float] = None,
    taken: Optional[float] = None,
) -> MountedScan:
    """Return a scan with the pose of its lidar at its time; the newest pose where tf does not know that time yet.

    Upstream amcl looks the pose up once and keeps it, whatever tf says later. The lidar may be mounted upside down.

    Args:
        message: The scan.
        base_frame: The robot's base frame.
        transforms: The tf buffer.
        max_age: Largest age (s) of the newest transform of a lidar that moves on the robot; no limit where None.
        taken: ROS time (s) at which the scan was taken; its stamp where None.

    Raises:
        InvalidMessage: The scan is invalid, or its lidar is tilted too far.
        TransformError: There is no transform from the sensor's frame to the base frame, or it is too old.
    """
    scan = scan_from_message(message)
    when = scan.stamp if taken is None else taken
    placed, is_fixed = placed_when(when, scan.frame, base_frame, transforms, max_age)
    upright = _upright(placed.transform)
    if abs(upright) < LEAST_LEVEL:
        raise InvalidMessage(
            f"the lidar in frame {shown(scan.frame)} is tilted by {math.degrees(math.acos(upright)):.0f} degrees "
            f"against {base_frame} and does not look round it, as one in a camera's optical frame")
    if abs(upright) < LEVEL:
        scan = _seen_along_the_floor(scan, placed)
    pose, upside_down = mounting_of(placed.transform)
    return MountedScan(seen_from_above(scan, upside_down), pose, is_fixed)


def placed_when(
    stamp: float, frame: str, base_frame: str, transforms: Transforms, max_age: Optional[float] = None
) -> Tuple[TransformStamped, bool]:
    """Return a sensor's transform to the base frame at `stamp` (s), else the newest, and whether it is static.

    Arguments and errors are those of `scan_in_base`.
    """
    placed = transforms.lookup_message(base_frame, frame, max_age=max_age)
    is_fixed = placed.header.stamp.to_sec() == 0.0 or frame.lstrip("/") == base_frame.lstrip("/")
    if not is_fixed:
        with contextlib.suppress(TransformError):
            placed = transforms.lookup_message(base_frame, frame, stamp)
    return placed, is_fixed


def mounting_of(transform: Transform) -> Tuple[Pose2D, bool]:
    """Return a lidar's pose in the base frame, and whether it is upside down, from its transform to the base."""
    q, p = transform.rotation, transform.translation
    # First column of the rotation matrix: the sensor's x axis, seen from above.
    forward_x = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    forward_y = 2.0 * (q.x * q.y + q.w * q.z)
    return Pose2D(p.x, p.y, math.atan2(forward_y, forward_x)), _upright(transform) < 0.0


def _seen_along_the_floor(scan: LaserScan, placed: TransformStamped) -> LaserScan:
    """Return a tilted lidar's scan with ranges projected onto the floor, which are shorter than along the beam."""
    beams = np.stack((np.cos(scan.angles), np.sin(scan.angles)))
    shares = np.hypot(*(rigid(placed)[0][:2, :2] @ beams))
    return replace(
        scan, ranges=np.where(scan.hit, shares * scan.ranges, scan.ranges),
        range_min=float(shares.min()) * scan.range_min)


def _upright(transform: Transform) -> float:
    """Return the cosine of the angle between a sensor's z axis and the vertical, -1 to 1."""
    x, y = float(transform.rotation.x), float(transform.rotation.y)
    return max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y)))


def seen_from_above(scan: LaserScan, upside_down: bool) -> LaserScan:
    """Return a scan with its angles counter-clockwise seen from above: mirrored where its lidar is upside down."""
    if not upside_down:
        return scan
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
