"""Whether others can reach a node where it tells them to: a wrong ROS_HOSTNAME or ROS_IP is noticed by nobody else."""

from __future__ import annotations

import threading
from urllib.parse import urlparse

import rospy

from mbf_relay.ros.common.impatient_proxy import NO_ANSWER, impatient_proxy

PATIENCE = 5.0
"""Wall seconds for an answer of one's own."""
AT_HOME = ("localhost", "127.0.0.1", "::1")


def warn_where_unreachable() -> None:
    """Warn, when it turns out, where this node cannot reach itself by the address that the master has of it.

    The node registers all the same, says that it is ready, and no message or goal ever comes.
    """
    address = rospy.get_node_uri()
    if address and urlparse(address).hostname not in AT_HOME:
        threading.Thread(target=look, args=(address,), name="own address", daemon=True).start()


def look(address: str) -> None:
    """Ask for a sign of life at an address; warn where there is none."""
    try:
        impatient_proxy(address, PATIENCE).getPid(rospy.get_name())
    except NO_ANSWER as error:
        if not rospy.core.is_shutdown_requested():
            rospy.logwarn(
                "this node advertises the address %s, where it cannot be reached from here (%s); other nodes may not "
                "reach it either: see ROS_HOSTNAME and ROS_IP", address, error)
