"""Odometry as it comes in: thirty messages a second, of which most are never looked at."""

from __future__ import annotations

from typing import Any, Tuple

import genpy
from nav_msgs.msg import Odometry

from mbf_relay.geometry import Twist2D
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.checks import InvalidMessage, check_stamp
from mbf_relay.ros.common.conversions import twist_from_message
from mbf_relay.ros.common.unread import unread

RawOdometry = unread(Odometry)
"""What to subscribe to."""


def read_odometry(message: Any, topic: str, now: float, max_age: float) -> Tuple[Odometry, float, Twist2D]:
    """Return a message, its time (s) and its velocity (body frame).

    Args:
        message: A RawOdometry.
        topic: Where it came from, for the error.
        now: Seconds.
        max_age: Seconds.

    Raises:
        StaleDataError: It is too old or from the future, cannot be read, or its velocity is none.
    """
    try:
        odometry = message.read()
        stamp = odometry.header.stamp.to_sec()
        if now - stamp > max_age:
            raise StaleDataError(f"odometry on {topic} is {now - stamp:.2f} s old; at most {max_age:.2f} s allowed")
        check_stamp(stamp, now)
        return odometry, stamp, twist_from_message(odometry.twist.twist)
    except genpy.DeserializationError as error:
        raise StaleDataError(f"odometry on {topic} cannot be read: {error}") from error
    except InvalidMessage as error:
        raise StaleDataError(f"odometry on {topic}: {error}") from error
