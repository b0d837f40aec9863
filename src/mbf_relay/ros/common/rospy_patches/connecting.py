"""Connections of subscribers to publishers: four defects of rospy by which messages never arrive.

A subscriber learns of a publisher twice: from the master's answer to its registration, and from publisherUpdate. rospy
handles each in a thread. Where both find no connection yet, the second one closes the first, with all that was sent on
it: the first goal of an action, which a client sends as soon as it sees a connection, was lost.

A publisher that unadvertises a topic for a moment, as RViz does while it sets up its tools, refuses connections
meanwhile. rospy gives such a connection up but goes on counting it, so that it never connects again.

If it unadvertises the topic for even shorter, publisherUpdate comes before the end of the old connection is noticed.
rospy then sees the publisher as connected, and never connects again either.

A subscriber connects as soon as the master has answered, in another thread, and is given its callback, its queue size
and its buffer size afterwards. What came in between, such as the only map, was lost.
"""

from __future__ import annotations

import io
import time
from typing import Any, Callable, List

import rospy
from rospy.core import is_shutdown
from rospy.exceptions import TransportInitError
from rospy.impl import tcpros_pubsub
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import get_topic_manager

from mbf_relay.ros.common.rospy_patches.accepting import has_hung_up
from mbf_relay.ros.common.rospy_patches.named_locks import NamedLocks

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 30.0
"""Wall seconds until the next attempt after a publisher's refusal: at first, and at most; each is twice the last."""
CONNECT_TIMEOUT = 60.0
"""Wall seconds for a TCP connection and its handshake, as in rospy's robust_connect_subscriber."""
ENDING_PAUSE = 0.02
"""Wall seconds between two checks whether rospy has dropped a connection that the publisher has closed."""
_connect_as_rospy = ROSHandler._connect_topic
_make_as_rospy, _open_as_rospy = rospy.Subscriber.__init__, tcpros_pubsub.TCPROSHandler.create_transport
_locks = NamedLocks()
_making = NamedLocks()  # by topic, held while a subscriber is made or given a connection; taken after `_locks`


def apply_patches() -> None:
    """Apply this module's patches to rospy; before rospy.init_node."""
    ROSHandler._connect_topic = connect_topic
    rospy.Subscriber.__init__ = make_subscriber
    tcpros_pubsub.TCPROSHandler.create_transport = open_connection
    tcpros_pubsub.robust_connect_subscriber = connect_and_receive


def make_subscriber(subscriber: Any, name: str, *arguments: Any, **options: Any) -> None:
    """Make a subscriber as its class does, and have connections wait until it is complete; replaces its __init__."""
    with _making.of(rospy.resolve_name(name)):
        _make_as_rospy(subscriber, name, *arguments, **options)


def open_connection(handler: Any, topic: str, *what: Any) -> Any:
    """Begin to connect as TCPROSHandler.create_transport does, which it replaces, to a subscriber that is complete."""
    with _making.of(topic):
        return _open_as_rospy(handler, topic, *what)


def connect_topic(handler: Any, topic: str, publisher: str) -> Any:
    """Connect as ROSHandler._connect_topic does, one thread at a time for each topic and publisher; replaces it.

    Waits until connections that the publisher has closed are dropped, so that what came by them is read first; those
    still open are kept.
    """
    with _locks.of((topic, publisher)):
        while not is_shutdown() and any(map(is_ended, connections_with(topic, publisher))):
            time.sleep(ENDING_PAUSE)
        return _connect_as_rospy(handler, topic, publisher)


def connections_with(topic: str, publisher: str) -> List[Any]:
    """Return rospy's connections of this process' subscribers of a topic with a publisher, by its XML-RPC URI."""
    subscriber = get_topic_manager().get_subscriber_impl(topic)
    return [link for link in subscriber.connections if link.endpoint_id == publisher] if subscriber else []


def is_ended(connection: Any) -> bool:
    """Return whether a connection was closed, by the publisher or in this process."""
    looked_at = connection.socket
    if looked_at is None:  # closed, or not made yet
        return connection.protocol is None
    try:
        return has_hung_up(looked_at)
    except ValueError:  # it is being closed
        return True


def connect_and_receive(
    connection: Any, address: str, port: int, publisher: str, receive: Callable[..., None], topic: str
) -> None:
    """Connect and receive until either side closes the connection; replaces robust_connect_subscriber.

    A refused connection is retried as long as the publisher says that it publishes the topic. If it no longer does, the
    connection is closed, so that it is not counted when the topic is advertised again.

    Args:
        connection: rospy's transport.
        address, port: Of the publisher's TCPROS server.
        publisher: The publisher's XML-RPC URI.
        receive: Takes the messages.
        topic: Name of the topic.
    """
    pause = FIRST_PAUSE
    while not connection.done and not is_shutdown():
        try:
            connection.connect(address, port, publisher, timeout=CONNECT_TIMEOUT)
            break
        except TransportInitError:
            if connection.done:  # rospy has closed it, as nobody listens there
                return
        refused, connection.socket, connection.read_buff = connection.socket, None, io.BytesIO()
        if refused is not None:
            refused.close()
        time.sleep(pause)
        pause = min(2.0 * pause, LONGEST_PAUSE)
        if not tcpros_pubsub.check_if_still_publisher(topic, publisher):
            connection.close()
    if not connection.done:
        connection.receive_loop(receive)
