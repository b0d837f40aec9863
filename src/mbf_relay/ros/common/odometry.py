"""Odometry as it comes in: thirty messages a second, of which most are never looked at."""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Tuple

import genpy
import rospy
from nav_msgs.msg import Odometry

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.navigation.odometry_monitor import TwistMonitor
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.checks import InvalidMessage, check_stamp, why_old
from mbf_relay.ros.common.connected_nodes import connected_nodes
from mbf_relay.ros.common.conversions import twist_from_message
from mbf_relay.ros.common.unread import unread

RawOdometry = unread(Odometry)
"""An Odometry message as it came."""
FALLEN_SILENT = 2.0
"""Wall seconds after which another node is heard in the place of one that is there and says nothing."""
WARN_PERIOD = 10.0
"""Seconds between two warnings of a second node."""
DOUBT_PERIOD = 60.0
"""Seconds between two warnings of velocities that are none: they are what the driver tells all the time."""


class OdometryInput:
    """Subscribes to odometry and keeps the newest.

    Of several nodes that publish on the topic only one is heard, who came first, as of those that tell of one frame on
    /tf: a robot drives by either, and by both in turn by neither.

    Args:
        topic: Its name.

    Attributes:
        topic: Resolved.
    """

    def __init__(self, topic: str) -> None:
        self.topic = rospy.resolve_name(topic)
        self._newest: Any = None  # with the time (s) at which it came
        self._teller, self._heard_at = "", -math.inf
        self._twists, self._judging = TwistMonitor(), threading.Lock()  # drives and recoveries ask from their threads
        self._subscriber: Any = None  # messages may come before it is there
        self._subscriber = rospy.Subscriber(
            topic, RawOdometry, self._take, queue_size=1, buff_size=1 << 18, tcp_nodelay=True)

    @property
    def is_expected(self) -> bool:
        """Whether there has been any, or somebody is there to send it."""
        return self._newest is not None or self._subscriber.get_num_connections() > 0

    def read(self, now: float, max_age: float) -> Tuple[Odometry, float, Twist2D]:
        """Return the newest message, its time (s) and its velocity (body frame).

        That of a driver that tells no time is of when it came, as to move_base, which looks at no stamp.

        Args:
            now: Seconds.
            max_age: Seconds.

        Raises:
            StaleDataError: There is none, it is too old or from the future, cannot be read, or its velocity is none.
        """
        if self._newest is None:
            raise StaleDataError(f"no odometry on {self.topic} yet")
        try:
            message, came_at = self._newest
            odometry = message.read()
            stamp = came_at if odometry.header.stamp.is_zero() else odometry.header.stamp.to_sec()
            if now - stamp > max_age:
                raise StaleDataError(
                    f"odometry on {self.topic} is {now - stamp:.2f} s old; at most {max_age:.2f} s allowed"
                    + why_old(now - stamp, now - came_at))
            check_stamp(stamp, now)
            velocity = twist_from_message(odometry.twist.twist)
        except genpy.DeserializationError as error:
            raise StaleDataError(f"odometry on {self.topic} cannot be read: {error}") from error
        except InvalidMessage as error:
            raise StaleDataError(f"odometry on {self.topic}: {error}") from error
        with self._judging:
            velocity, doubt = self._twists.believed(stamp, planar_pose(odometry), velocity), self._twists.doubt
        if doubt:
            rospy.logwarn_throttle(
                DOUBT_PERIOD, f"{doubt}, and the latter is used; have the driver that publishes on "
                f"{self.topic} fill in twist, in the frame of child_frame_id")
        return odometry, stamp, velocity

    def _take(self, message: Any) -> None:
        teller, now = message._connection_header.get("callerid", ""), time.monotonic()
        speaks = now - self._heard_at <= FALLEN_SILENT and self._subscriber is not None
        if teller != self._teller and speaks and self._teller in connected_nodes(self._subscriber):
            rospy.logwarn_throttle(
                WARN_PERIOD, f"odometry on {self.topic} comes from {self._teller} and from {teller}: only the first "
                "is heard; have the other publish elsewhere, or end it")
            return
        self._teller, self._heard_at, self._newest = teller, now, (message, rospy.get_time())


def planar_pose(odometry: Odometry) -> Pose2D:
    """Return odometry's pose as it is: a driver that fills in velocities alone is none to refuse."""
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    return Pose2D(position.x, position.y, 2.0 * math.atan2(turn.z, turn.w))
