"""Which nodes publish to a subscriber: those whose messages can arrive."""

from types import SimpleNamespace

from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub
from std_msgs.msg import String

from mbf_relay.ros.common.connected_nodes import connected_nodes


def test_a_goal_that_is_sent_once_is_not_lost_to_a_connection_that_has_only_begun():
    """rospy lists it as soon as it has asked for it, and what is published before the handshake goes to nobody."""
    begun, made = (TCPROSTransport(TCPROSSub("/goal", String), "/goal") for _ in range(2))
    begun.set_endpoint_id("http://here:1")
    made.set_endpoint_id("http://here:2")
    made._validate_header({"type": String._type, "md5sum": String._md5sum, "callerid": "/relay"})
    assert connected_nodes(SimpleNamespace(impl=SimpleNamespace(connections=[begun, made]))) == {"/relay": "http://here:2"}
    assert connected_nodes(SimpleNamespace(impl=None)) == {}
