"""Client of the service static_map, called until it returns a usable map."""

from __future__ import annotations

import contextlib
import time
import xmlrpc.client  # nosec B411: what the ROS master speaks

import rospy
from nav_msgs.msg import OccupancyGrid

from mbf_relay.localization.distance_field import check_map
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.checks import shown
from mbf_relay.ros.common.conversions import map_from_message
from mbf_relay.ros.common.quick_map_services import QuickGetMap
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings

AGAIN_AFTER = 0.5
"""Wall time (s) from a failed call to the next."""
FIRST_LOOKS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.3)
"""Wall times (s) between the first checks for the service, as map_server may be starting; rospy checks every 0.3 s."""


def warn_of_frame(message: OccupancyGrid, frame: str) -> None:
    """Warn of a map whose header names another frame than global_frame_id, in which it is used."""
    said = message.header.frame_id.lstrip("/")
    if said != frame:
        rospy.logwarn(
            "the map is in frame '%s', not in global_frame_id '%s'; it is used as if it were in the latter",
            shown(said), frame)


def request_map(frame: str) -> OccupancyMap:
    """Return the map of the service static_map, once there is one that can be used for localization.

    Args:
        frame: Frame in which it is used.

    Raises:
        rospy.ROSInterruptException: The node shuts down.
    """
    warnings = ThrottledWarnings()
    while not rospy.is_shutdown():
        try:
            _look_for_service(rospy.resolve_name("static_map"))
            rospy.wait_for_service("static_map", timeout=5.0)
            message = rospy.ServiceProxy("static_map", QuickGetMap)().map
            occupancy = map_from_message(message)
            check_map(occupancy)
            warn_of_frame(message, frame)
            return occupancy
        except rospy.ROSInterruptException:
            raise
        except (rospy.ROSException, rospy.ServiceException, ValueError) as error:
            warnings.say(f"no map from {rospy.resolve_name('static_map')} yet, trying again: {error}")
            time.sleep(AGAIN_AFTER)
    raise rospy.ROSInterruptException("shut down while waiting for the map")


def _look_for_service(name: str) -> None:
    """Return once the master knows a service, or after the sum of FIRST_LOOKS."""
    for pause in FIRST_LOOKS:
        with contextlib.suppress(OSError, xmlrpc.client.Error):  # no master: rospy waits for it
            if rospy.get_master().lookupService(name)[0] == 1:
                return
        time.sleep(pause)
