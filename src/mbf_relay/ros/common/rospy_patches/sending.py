"""Sending messages with less CPU time than rospy, and two defects of its publishers.

rospy passes each message to a thread of each connection, so that a subscriber that hangs does not block the others: for
`/clock` alone, at 60 Hz, ten threads wake up. A small message for which the socket's buffer has room is sent directly
here; all others are left to rospy's threads.

A message for a new subscriber alone (rospy.SubscribeListener) is serialized by rospy into the topic's buffer without
the publisher's lock. A velocity that was published at that moment arrived with other numbers, or the wheels lost their
connection. Here the lock is taken.

Of a message that cannot be serialized, e.g. with a string in place of a number, rospy leaves the first part in the
buffer, so that subscribers cannot read what follows. Here the buffer is cleared.
"""

from __future__ import annotations

import select
import time
from typing import Any, Optional

import rospy.topics
from rospy.impl.tcpros_pubsub import QueuedConnection

SMALL = 4096
"""Largest message (bytes) sent directly: a socket that is writable accepts as much without blocking."""
_publish_as_rospy = rospy.topics._PublisherImpl.publish


def apply_patches() -> None:
    """Apply this module's patches to rospy; before the first publisher."""
    rospy.topics.QueuedConnection = DirectConnection
    rospy.topics._PublisherImpl.publish = publish_alone


def publish_alone(topic: Any, message: Any, connection_override: Any = None) -> Any:
    """Publish as _PublisherImpl.publish does, which it replaces, with the topic's lock held and no partial message.

    Raises:
        ROSException: The topic is closed.
        ROSSerializationException, SerializationError, ValueError: A field of the message has a wrong type.
    """
    lock = topic.publock
    if lock is None:  # closed; rospy raises the error
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
    """rospy's queue and thread for one subscriber, which a small message bypasses while the queue is empty."""

    _sending = False  # whether a thread writes to the socket, this one's or a publisher's; guarded by _lock
    _room: Optional[Any] = None  # polls whether the socket is writable
    _queue: Any  # of the base class, declared for mypy
    _error: Any

    def write_data(self, data: bytes) -> bool:
        """Send a small message at once where the socket is writable, else queue it for the thread; return True.

        Raises:
            TransportTerminated: The subscriber is gone.
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
            time.sleep(0)  # as rospy does, to let the thread run
            return True
        try:
            self._connection.write_data(data)  # without the lock, which is taken when the connection is closed
        finally:
            with self._lock:
                self._sending = False
                if self._queue:
                    self._cond_data_available.notify()
        return True

    def _has_room(self) -> bool:
        """Return whether the socket accepts a small message without blocking."""
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
                except Exception as error:  # raised at the next publish
                    with self._lock:
                        self._error = error
            with self._lock:
                self._sending = False
