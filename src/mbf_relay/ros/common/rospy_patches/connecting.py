"""Connections of subscribers: made once, and not given up where the publisher was not ready.

A node that subscribes hears of a publisher twice: from the master's answer, and from its update. rospy takes each up in
a thread, and where both find nothing connected yet, the second connection closes the first, with all that was sent on
it: an action's first goal, which a client sends as soon as it sees a connection, never came.

A publisher that takes a topic back for a moment, as RViz does while it sets up its tools, refuses whoever comes just
then. rospy gives up such a connection but goes on counting it as one, so that nothing of the topic is ever heard.

Of a publisher that takes it back for less, the master tells again before the last connection's end is noticed here.
rospy leaves alone what it still counts as connected, and nothing is ever heard either.
"""

from __future__ import annotations

import io
import select
import time
from typing import Any, Callable, List

from rospy.core import is_shutdown
from rospy.exceptions import TransportInitError
from rospy.impl import tcpros_pubsub
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import get_topic_manager

from mbf_relay.ros.common.rospy_patches.named_locks import NamedLocks

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 30.0
"""Wall seconds until a publisher that refused is asked again: the first time, and at most; each is twice the last."""
CONNECT_TIMEOUT = 60.0
ENDING_PAUSE = 0.02
"""Wall seconds between two looks whether a connection that the publisher has ended is no longer counted."""
_connect_as_rospy = ROSHandler._connect_topic
_locks = NamedLocks()


def connect_surely() -> None:
    """Have this process connect each subscriber with each publisher, once and in the end; before rospy.init_node."""
    ROSHandler._connect_topic = connect_topic
    tcpros_pubsub.robust_connect_subscriber = connect_and_receive


def connect_topic(handler: Any, topic: str, publisher: str) -> Any:
    """Connect as ROSHandler._connect_topic does, which leaves alone what is connected, after whoever is at it now.

    What is connected and ended by the publisher is waited for: all that came by it is read before.
    """
    with _locks.of((topic, publisher)):
        while not is_shutdown() and any(map(is_ended, connections_with(topic, publisher))):
            time.sleep(ENDING_PAUSE)
        return _connect_as_rospy(handler, topic, publisher)


def connections_with(topic: str, publisher: str) -> List[Any]:
    """Return what is counted as connections of this process's subscribers of a topic with a publisher."""
    subscriber = get_topic_manager().get_subscriber_impl(topic)
    return [link for link in subscriber.connections if link.endpoint_id == publisher] if subscriber else []


def is_ended(connection: Any) -> bool:
    """Return whether the publisher has ended a connection, or it has been closed here."""
    looked_at, poll = connection.socket, select.poll()
    if looked_at is None:  # closed, or not made yet
        return connection.protocol is None
    try:
        poll.register(looked_at, select.POLLRDHUP)
    except ValueError:  # it is being closed
        return True
    return bool(poll.poll(0))


def connect_and_receive(
    connection: Any, address: str, port: int, publisher: str, receive: Callable[..., None], topic: str
) -> None:
    """Connect, in a thread of its own, and receive until either side ends it; in place of robust_connect_subscriber.

    A publisher that refuses is asked again for as long as it says that it publishes the topic. Where it no longer does,
    the connection is closed, so that it counts as none when the topic comes back.
    """
    pause = FIRST_PAUSE
    while not connection.done and not is_shutdown():
        try:
            connection.connect(address, port, publisher, timeout=CONNECT_TIMEOUT)
            break
        except TransportInitError:
            if connection.done:  # nobody is there: rospy has closed it
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
