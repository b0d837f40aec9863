"""Which nodes publish to a subscriber, as its connections tell: no master is asked."""

from __future__ import annotations

from typing import Any, Dict


def connected_nodes(subscriber: Any) -> Dict[str, str]:
    """Return the addresses of the nodes that publish to a rospy.Subscriber, by name, newest last."""
    connections = subscriber.impl.connections if subscriber.impl else []
    return {link.callerid_pub: link.endpoint_id for link in connections if link.callerid_pub}
