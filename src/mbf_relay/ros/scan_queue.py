"""Scans wait here until the odometry of their time is known."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import replace
from typing import Callable, Deque, Dict, List, Optional, Tuple

import rospy
from geometry_msgs.msg import Transform
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.conversions import scan_from_message
from mbf_relay.ros.transforms import Transforms
from mbf_relay.scan import LaserScan

_ONE_SECOND = rospy.Duration(1.0)


class ScanQueue:
    """Scans in the order of their coming, given out once their transform is there.

    Callbacks put, one worker takes. Of several scans of one lidar that are ready together only the newest is given:
    the filter moves by odometry, and a scan it is late for would only make it later.
    """

    def __init__(self, length: int = 100) -> None:
        self._changed = threading.Condition()  # guards the deque; nothing else is locked while it is held
        self._waiting: Deque[LaserScanMessage] = deque(maxlen=length)

    def put(self, message: LaserScanMessage) -> None:
        """Add a scan; the oldest goes where there is no room."""
        with self._changed:
            if self._waiting and message.header.stamp + _ONE_SECOND < self._waiting[-1].header.stamp:
                self._waiting.clear()  # time was set back: what waits belongs to a world that is over
            self._waiting.append(message)
            self._changed.notify()

    def take(self, is_ready: Callable[[LaserScanMessage], bool], timeout: float) -> List[LaserScanMessage]:
        """Return the newest ready scan of each frame, or nothing after `timeout` seconds of wall time without one."""
        with self._changed:
            if not self._waiting:
                self._changed.wait(timeout)
            waiting = list(self._waiting)
        ready: Dict[str, LaserScanMessage] = {message.header.frame_id: message for message in waiting if is_ready(message)}
        with self._changed:
            newest = {frame: message.header.stamp for frame, message in ready.items()}
            left = [m for m in self._waiting if m.header.frame_id not in newest or m.header.stamp > newest[m.header.frame_id]]
            self._waiting.clear()
            self._waiting.extend(left)
            if not ready and left:
                self._changed.wait(min(timeout, 0.005))  # tf tells nobody of its changes
        return sorted(ready.values(), key=lambda message: message.header.stamp)

    def oldest(self) -> Optional[LaserScanMessage]:
        """Return the scan that has waited longest, None where none waits."""
        with self._changed:
            return self._waiting[0] if self._waiting else None


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
