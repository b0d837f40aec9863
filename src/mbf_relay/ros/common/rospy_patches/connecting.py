"""Connections of subscribers, made once.

A node that subscribes hears of a publisher twice: from the master's answer, and from its update. rospy takes each up in
a thread, and where both find nothing connected yet, the second connection closes the first, with all that was sent on
it: an action's first goal, which a client sends as soon as it sees a connection, never came.
"""

from __future__ import annotations

from typing import Any

from rospy.impl.masterslave import ROSHandler

from mbf_relay.ros.common.rospy_patches.named_locks import NamedLocks

_connect_as_rospy = ROSHandler._connect_topic
_locks = NamedLocks()


def connect_once() -> None:
    """Have this process connect each subscriber with each publisher in one thread at a time; before rospy.init_node."""
    ROSHandler._connect_topic = connect_topic


def connect_topic(handler: Any, topic: str, publisher: str) -> Any:
    """Connect as ROSHandler._connect_topic does, which leaves alone what is connected, after whoever is at it now."""
    with _locks.of((topic, publisher)):
        return _connect_as_rospy(handler, topic, publisher)
