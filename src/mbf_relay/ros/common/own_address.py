"""Checks that a node can be reached at the address it advertises, to report a wrong ROS_HOSTNAME or ROS_IP."""

from __future__ import annotations

import threading
from urllib.parse import urlparse

import rospy

from mbf_relay.ros.common.impatient_proxy import NO_ANSWER, impatient_proxy

PATIENCE = 5.0
"""Wall seconds for the node's own answer."""
AT_HOME = ("localhost", "127.0.0.1", "::1")
"""Hosts that are not checked: always this machine."""


def warn_where_unreachable() -> None:
    """Warn, from a thread of its own, if this node cannot reach itself at the address it has registered.

    Such a node registers and seems ready, but receives no message and no goal.
    """
    address = rospy.get_node_uri()
    if address and urlparse(address).hostname not in AT_HOME:
        threading.Thread(target=check, args=(address,), name="own address", daemon=True).start()


def check(address: str) -> None:
    """Call the node at an XML-RPC address; warn if it does not answer."""
    try:
        impatient_proxy(address, PATIENCE).getPid(rospy.get_name())
    except NO_ANSWER as error:
        if not rospy.core.is_shutdown_requested():
            rospy.logwarn(
                "this node advertises the address %s, where it cannot be reached from here (%s); other nodes may not "
                "reach it either: see ROS_HOSTNAME and ROS_IP", address, error)
