"""Where messages wait, unread, for the thread that shows them."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Deque, Dict, List, Mapping, Tuple

import rospy

WAITING = 1000
"""Messages of one topic at most; who is so far behind gets the newest of them."""


class Inbox:
    """Takes messages from rospy's threads as bytes: only what is looked at is ever taken apart.

    `_lock` stands between rospy's threads and the one that empties it; nothing else is done under it.

    Args:
        periods: Seconds between two messages handed out of a topic, by its key; where none is named, as they come.
    """

    def __init__(self, periods: Mapping[str, float]) -> None:
        self._periods = periods
        self._due: Dict[str, float] = {}
        self._lock = threading.Lock()
        self._waiting: Dict[str, Deque[Tuple[int, Any]]] = {}
        self._count = 0

    def put(self, key: str, message: Any, every: bool) -> None:
        """Keep a message; the last alone unless `every` one counts."""
        with self._lock:
            waiting = self._waiting.setdefault(key, deque(maxlen=WAITING))
            if not every:
                waiting.clear()
            self._count += 1
            waiting.append((self._count, message))

    def take(self, now: float) -> List[Tuple[str, Any]]:
        """Return what waits and is due at `now` (s), with its keys, in the order it came."""
        with self._lock:
            keys = [key for key in self._waiting if now >= self._due.get(key, now)]
            waiting = {key: self._waiting.pop(key) for key in keys}
        for key in keys:
            self._due[key] = now + self._periods.get(key, 0.0)
        came = sorted((count, key, message) for key, messages in waiting.items() for count, message in messages)
        return [(key, message) for _, key, message in came]


def subscribe(topic: str, kind: Any, take: Any) -> rospy.Subscriber:
    """Subscribe to unread messages."""
    return rospy.Subscriber(topic, kind, take, queue_size=None, buff_size=1 << 22, tcp_nodelay=True)
