"""Input of odometry: the newest message, deserialized only when it is asked for."""

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
"""An Odometry message as bytes."""
FALLEN_SILENT = 2.0
"""Wall seconds of silence after which a connected publisher is replaced by another one."""
WARN_PERIOD = 10.0
"""Seconds between two warnings of a second publisher."""
DOUBT_PERIOD = 60.0
"""Seconds between two warnings that twist contradicts the poses: a driver's fault that lasts."""


class OdometryInput:
    """Subscribes to odometry and keeps the newest message.

    Of several publishers only the first is used while it is alive, as for one frame on /tf: a robot cannot drive by two
    odometries that alternate.

    Args:
        topic: Name of the topic.

    Attributes:
        topic: Its resolved name.
    """

    def __init__(self, topic: str) -> None:
        self.topic = rospy.resolve_name(topic)
        self._newest: Any = None  # the message, and the ROS time (s) at which it arrived
        self._teller, self._heard_at = "", -math.inf
        self._twists, self._judging = TwistMonitor(), threading.Lock()  # drives and recoveries ask from their threads
        self._subscriber: Any = None  # messages may arrive before the constructor has returned
        self._subscriber = rospy.Subscriber(
            topic, RawOdometry, self._take, queue_size=1, buff_size=1 << 18, tcp_nodelay=True)

    @property
    def is_expected(self) -> bool:
        """Whether there was a message, or there is a publisher."""
        return self._newest is not None or self._subscriber.get_num_connections() > 0

    def read(self, now: float, max_age: float) -> Tuple[Odometry, float, Twist2D]:
        """Return the newest message, its stamp (s) and its velocity (body frame).

        Where the stamp is zero, the time of arrival counts. The velocity is TwistMonitor's: derived from the poses
        where the message's own contradicts them.

        Args:
            now: ROS time (s).
            max_age: Largest age (s).

        Raises:
            StaleDataError: There is none, it is too old or ahead of the clock, cannot be deserialized, or its velocity
                is invalid.
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
                DOUBT_PERIOD, f"{doubt}, and the latter is used; have the driver that publishes on {self.topic} send "
                "poses and a twist, in the frame of child_frame_id, that agree; one may be 0, in other units, or noise")
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
    """Return odometry's pose without checks, as some drivers fill in velocities alone; yaw (rad) in -2 pi to 2 pi."""
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    return Pose2D(position.x, position.y, 2.0 * math.atan2(turn.z, turn.w))
