"""The map by service, asked for until it comes."""

from __future__ import annotations

import time

import rospy
from nav_msgs.srv import GetMap

from mbf_relay.localization.distance_field import check_map
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.conversions import map_from_message
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings

AGAIN_AFTER = 0.5


def request_map() -> OccupancyMap:
    """Return what `static_map` serves, once it serves a map that can be localized on.

    Raises:
        rospy.ROSInterruptException: The node shuts down.
    """
    warnings = ThrottledWarnings()
    while not rospy.is_shutdown():
        try:
            rospy.wait_for_service("static_map", timeout=5.0)
            occupancy = map_from_message(rospy.ServiceProxy("static_map", GetMap)().map)
            check_map(occupancy)
            return occupancy
        except rospy.ROSInterruptException:
            raise
        except (rospy.ROSException, rospy.ServiceException, ValueError) as error:
            warnings.say(f"no map from {rospy.resolve_name('static_map')} yet, trying again: {error}")
            time.sleep(AGAIN_AFTER)
    raise rospy.ROSInterruptException("shut down while waiting for the map")
