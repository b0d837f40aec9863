"""Where each lidar sits on the robot, which way up, and its scans as the base sees them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Dict, Tuple

from geometry_msgs.msg import Transform
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.conversions import scan_from_message
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan


class LidarGeometry:
    """Where each lidar sits on the robot, looked up once; a lidar may hang upside down."""

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self._known: Dict[Tuple[str, str], Tuple[Pose2D, bool]] = {}

    def forget(self) -> None:
        """Look everything up again, for another base frame."""
        self._known.clear()

    def scan_in_base(self, message: LaserScanMessage, base_frame: str) -> Tuple[LaserScan, Pose2D]:
        """Return a scan as seen from above, and its sensor's pose in the base's frame.

        Raises:
            InvalidMessage: The scan holds nothing usable.
            TransformError: The sensor's frame is not connected to the base's.
        """
        scan = scan_from_message(message)
        key = (scan.frame, base_frame)
        if key not in self._known:
            self._known[key] = self._look_up(scan.frame, base_frame)
        pose, upside_down = self._known[key]
        return seen_from_above(scan, upside_down), pose

    def _look_up(self, frame: str, base_frame: str) -> Tuple[Pose2D, bool]:
        return mounting_of(self._transforms.lookup_message(base_frame, frame).transform)


def mounting_of(transform: Transform) -> Tuple[Pose2D, bool]:
    """Return where a lidar sits on the robot, and whether it hangs upside down, from its transform to the base."""
    q, p = transform.rotation, transform.translation
    # Of the rotation matrix: where the sensor's x axis points seen from above, and whether its z axis points up.
    forward_x = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    forward_y = 2.0 * (q.x * q.y + q.w * q.z)
    up_z = 1.0 - 2.0 * (q.x * q.x + q.y * q.y)
    return Pose2D(p.x, p.y, math.atan2(forward_y, forward_x)), up_z < 0.0


def seen_from_above(scan: LaserScan, upside_down: bool) -> LaserScan:
    """Return a scan with its angles counter-clockwise as the base sees them."""
    if not upside_down:
        return scan
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
