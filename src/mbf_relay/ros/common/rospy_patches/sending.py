"""What rospy does for each message that goes out, done with less.

rospy hands each message for each of its listeners to a thread of that listener's own, lest one that hangs hold up the
others: sixty times a second `/clock` alone wakes ten threads. A small message that the system takes at once, since its
buffer for that listener has room, needs no thread; whatever might have to wait is left to rospy's.

What a newcomer is told alone (rospy.SubscribeListener) rospy writes into the buffer that others publish by, without the
lock that these take. A velocity that went out at that moment arrived as other numbers, or the wheels lost their
connection. Here each message has the buffer to itself.

Of a message that cannot be written, as with a text where a number belongs, rospy leaves the part before that in the
buffer, and no listener understands what comes after it: to them the topic is lost. Here nothing is left of it.
"""

from __future__ import annotations

import select
import time
from typing import Any, Optional

import rospy.topics
from rospy.impl.tcpros_pubsub import QueuedConnection

SMALL = 4096
"""Bytes that the system takes in one piece where it takes any."""
_publish_as_rospy = rospy.topics._PublisherImpl.publish


def send_with_less() -> None:
    """Have this process send small messages with less work, and each by itself; before its first publisher."""
    rospy.topics.QueuedConnection = DirectConnection
    rospy.topics._PublisherImpl.publish = publish_alone


def publish_alone(topic: Any, message: Any, connection_override: Any = None) -> Any:
    """Publish as _PublisherImpl.publish does, while nobody else does so on the topic; a message goes out whole or not.

    Raises:
        ROSException: The topic is closed.
        ROSSerializationException, SerializationError, ValueError: The message has a field of another type than its own.
    """
    lock = topic.publock
    if lock is None:  # closed, of which rospy tells
        return _publish_as_rospy(topic, message, connection_override)
    with lock:
        latched = topic.latch
        try:
            return _publish_as_rospy(topic, message, connection_override)
        except Exception:
            topic.latch = latched
            if topic.buff is not None and not topic.buff.closed:
                topic.buff.seek(0)
                topic.buff.truncate(0)
            raise


class DirectConnection(QueuedConnection):
    """rospy's queue and thread for one listener, and a way past them while nothing waits there."""

    _sending = False  # somebody writes to the socket: the thread, or who publishes; guarded by _lock, as the queue is
    _room: Optional[Any] = None
    _queue: Any  # the base class's own, which has no types
    _error: Any

    def write_data(self, data: bytes) -> bool:
        """Send what is small and can go at once, else leave it to the thread; returns True.

        Raises:
            TransportTerminated: The listener is gone.
        """
        with self._lock:
            if self._error:
                error, self._error = self._error, None
                raise error
            direct = len(data) <= SMALL and not self._queue and not self._sending and self._has_room()
            if direct:
                self._sending = True
            else:
                if self._queue_size > 0 and len(self._queue) == self._queue_size:
                    del self._queue[0]
                self._queue.append(data)
                self._cond_data_available.notify()
        if not direct:
            time.sleep(0)  # as rospy does: the thread goes on
            return True
        try:
            self._connection.write_data(data)  # without the lock, which a connection that ends asks for
        finally:
            with self._lock:
                self._sending = False
                if self._queue:
                    self._cond_data_available.notify()
        return True

    def _has_room(self) -> bool:
        """Return whether the system takes a small message at once."""
        socket = self._connection.socket
        if self._connection.done or socket is None:
            return False
        if self._room is None:
            self._room = select.poll()
            self._room.register(socket, select.POLLOUT)
        return [event for _, event in self._room.poll(0)] == [select.POLLOUT]

    def _run(self) -> None:
        while not self._connection.done:
            with self._lock:
                while (self._sending or not self._queue) and not self._connection.done:
                    self._cond_data_available.wait()
                queue, self._queue = self._queue, []
                self._sending = True
            for data in queue:
                try:
                    self._connection.write_data(data)
                except Exception as error:  # whatever it is, who publishes next hears of it
                    with self._lock:
                        self._error = error
            with self._lock:
                self._sending = False
