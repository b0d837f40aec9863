"""The guard's lidars: where each sits on the robot, and which cannot be used for want of a transform."""

from __future__ import annotations

from typing import Dict, List, Optional, Tuple

import rospy
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import StaleDataError, TransformError
from mbf_relay.ros.common.checks import InvalidMessage, shown
from mbf_relay.ros.common.lidar_geometry import scan_in_base
from mbf_relay.ros.common.odometry import OdometryInput
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan
from mbf_relay.senders import AT_ONCE

MOTION_AGE = 0.5
"""Largest age (s) of odometry."""
WARN_PERIOD = 10.0
"""Seconds between two warnings of a lidar without a transform."""


class Lidars:
    """Tells where the lidar of each scan sits in the base frame.

    Args:
        base_frame: The robot's base frame.
        odometry: Tells in which frame the robot moves.

    Attributes:
        trouble: Why the last scan could not be used, empty where it could.
    """

    def __init__(self, base_frame: str, odometry: OdometryInput) -> None:
        self._base_frame, self._odometry = base_frame, odometry
        self._transforms = Transforms()
        self._unplaced: Dict[str, float] = {}  # time (s) of the last scan by frame, of lidars without a transform
        self._moving: Dict[str, float] = {}  # likewise, of lidars whose transform is not static
        self.trouble = ""

    def place(self, message: LaserScanMessage, now: float) -> Optional[Tuple[LaserScan, Pose2D, bool]]:
        """Return a scan, its lidar's pose in the base frame and whether the robot carries it; None if unusable."""
        frame = message.header.frame_id
        try:
            scan, laser_in_base, is_fixed = scan_in_base(message, self._base_frame, self._transforms, max_age=AT_ONCE)
            if not is_fixed:
                self._check_base(frame, now)
        except InvalidMessage as error:
            self.trouble = str(error)
            return None
        except TransformError as error:
            self.trouble = str(error)
            self._unplaced[frame] = now
            return None
        self.trouble = ""
        self._unplaced.pop(frame, None)
        if not is_fixed:
            self._moving[frame] = now
        without = self.without(now)
        if without:
            rospy.logwarn_throttle(WARN_PERIOD, f"passing velocities {without}")
        return scan, laser_in_base, self._transforms.rides_on(self._base_frame, frame)

    def follow(self, now: float) -> None:
        """Subscribe to /tf only while a lidar's transform is not static or unknown; /tf_static always is subscribed."""
        if _still_heard(self._unplaced, now) or _still_heard(self._moving, now):
            self._transforms.listen()
        else:
            self._transforms.rest()

    def without(self, now: float) -> str:
        """Return a text about lidars whose scans cannot be used for want of a transform; empty for none."""
        frames = _still_heard(self._unplaced, now)
        if not frames:
            return ""
        return f"without the lidar in {' and '.join(frames)}: tf does not tell where it sits in {self._base_frame}"

    def _check_base(self, frame: str, now: float) -> None:
        """Raise InvalidMessage where base_frame is no frame of the robot: odometry's lies between it and a lidar's."""
        try:
            odometry = self._odometry.read(now, MOTION_AGE)[0]
        except StaleDataError:
            return
        base, world = (name.lstrip("/") for name in (self._base_frame, odometry.header.frame_id))
        if {base, world} <= set(self._transforms.frames_above(frame, base)):
            raise InvalidMessage(
                f"base_frame is {base}, in which the robot moves, as odometry in {shown(world)} tells; it must be the "
                "robot's own, such as base_link")


def _still_heard(heard_at: Dict[str, float], now: float) -> List[str]:
    """Return the frames, of those with the time (s) of their last scan, that have sent within AT_ONCE."""
    return [frame for frame, time in heard_at.items() if abs(now - time) <= AT_ONCE]
