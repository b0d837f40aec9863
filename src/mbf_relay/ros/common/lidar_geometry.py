"""Where each lidar sits on the robot, which way up, and its scans as the base sees them."""

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
"""Cosine of the tilt beyond which a lidar stands on edge: its beams meet floor and ceiling, few walls."""
LEVEL = 0.9994
"""Cosine of the tilt up to which a lidar looks level: 2 degrees, which are not a millimetre in a metre."""


class MountedScan(NamedTuple):
    """A scan as seen from above, where its lidar sits in the base's frame, and whether /tf_static alone says so."""

    scan: LaserScan
    laser_in_base: Pose2D
    is_fixed: bool


def scan_in_base(
    message: LaserScanMessage, base_frame: str, transforms: Transforms, max_age: Optional[float] = None
) -> MountedScan:
    """Return a scan with where its lidar sat when it was taken, or sits now where that is not told yet.

    Upstream amcl asks once and keeps to it, whatever tf says later. A lidar may hang upside down.

    Args:
        message: The scan.
        base_frame: The robot's.
        transforms: Where the lidar is looked up.
        max_age: Age (s) beyond which what /tf says of a lidar that moves is refused; no limit where None.

    Raises:
        InvalidMessage: The scan holds nothing usable, or its lidar stands on edge.
        TransformError: The sensor's frame is not connected to the base's.
    """
    scan = scan_from_message(message)
    placed, is_fixed = placed_when(scan.stamp, scan.frame, base_frame, transforms, max_age)
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
    """Return where a sensor sat at a time (s), or sits now where that is not told yet, and whether for good.

    Arguments and errors are those of `scan_in_base`.
    """
    placed = transforms.lookup_message(base_frame, frame, max_age=max_age)
    is_fixed = placed.header.stamp.to_sec() == 0.0 or frame.lstrip("/") == base_frame.lstrip("/")
    if not is_fixed:
        with contextlib.suppress(TransformError):
            placed = transforms.lookup_message(base_frame, frame, stamp)
    return placed, is_fixed


def mounting_of(transform: Transform) -> Tuple[Pose2D, bool]:
    """Return where a lidar sits on the robot, and whether it hangs upside down, from its transform to the base."""
    q, p = transform.rotation, transform.translation
    # Of the rotation matrix: where the sensor's x axis points seen from above.
    forward_x = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    forward_y = 2.0 * (q.x * q.y + q.w * q.z)
    return Pose2D(p.x, p.y, math.atan2(forward_y, forward_x)), _upright(transform) < 0.0


def _seen_along_the_floor(scan: LaserScan, placed: TransformStamped) -> LaserScan:
    """Return what a tilted lidar hit as far away as it is on the floor, which is less than along the beam."""
    beams = np.stack((np.cos(scan.angles), np.sin(scan.angles)))
    shares = np.hypot(*(rigid(placed)[0][:2, :2] @ beams))
    return replace(
        scan, ranges=np.where(scan.hit, shares * scan.ranges, scan.ranges),
        range_min=float(shares.min()) * scan.range_min)


def _upright(transform: Transform) -> float:
    """Return by how much a sensor's z axis points up, -1 to 1."""
    x, y = float(transform.rotation.x), float(transform.rotation.y)
    return max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y)))


def seen_from_above(scan: LaserScan, upside_down: bool) -> LaserScan:
    """Return a scan with its angles counter-clockwise as the base sees them."""
    if not upside_down:
        return scan
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
