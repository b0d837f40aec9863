"""Odometry as it comes in: thirty messages a second, of which most are never looked at."""

from __future__ import annotations

from typing import Tuple

import genpy
import rospy
from nav_msgs.msg import Odometry

from mbf_relay.geometry import Twist2D
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.checks import InvalidMessage, check_stamp
from mbf_relay.ros.common.conversions import twist_from_message


class RawOdometry(rospy.AnyMsg):
    """An Odometry message as it came, to be read when it is needed."""

    _md5sum, _type = Odometry._md5sum, Odometry._type
    _full_text, _has_header = Odometry._full_text, False

    def read(self, topic: str, now: float, max_age: float) -> Tuple[Odometry, float, Twist2D]:
        """Return the message, its time (s) and its velocity (body frame).

        Args:
            topic: Where it came from, for the error.
            now: Seconds.
            max_age: Seconds.

        Raises:
            StaleDataError: It is too old or from the future, cannot be read, or its velocity is none.
        """
        try:
            odometry = Odometry().deserialize(self._buff)
            stamp = odometry.header.stamp.to_sec()
            if now - stamp > max_age:
                raise StaleDataError(
                    f"odometry on {topic} is {now - stamp:.2f} s old; at most {max_age:.2f} s allowed")
            check_stamp(stamp, now)
            return odometry, stamp, twist_from_message(odometry.twist.twist)
        except genpy.DeserializationError as error:
            raise StaleDataError(f"odometry on {topic} cannot be read: {error}") from error
        except InvalidMessage as error:
            raise StaleDataError(f"odometry on {topic}: {error}") from error
