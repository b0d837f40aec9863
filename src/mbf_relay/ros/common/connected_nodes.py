"""Which nodes publish to a subscriber, by its connections and without asking the master."""

from __future__ import annotations

from typing import Any, Dict

UNNAMED = ("", "unknown")
"""What rospy calls a publisher before the handshake, in which it tells its name."""


def connected_nodes(subscriber: Any) -> Dict[str, str]:
    """Return the XML-RPC URIs of the nodes that publish to a rospy.Subscriber, by node name, newest connection last.

    Connections whose handshake is still to come, by which nothing can arrive yet, are left out; rospy counts them.
    """
    connections = subscriber.impl.connections if subscriber.impl else []
    return {link.callerid_pub: link.endpoint_id for link in connections if link.callerid_pub not in UNNAMED}
