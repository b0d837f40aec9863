"""A queue of serialized messages for the thread that serves browsers."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Deque, Dict, List, Mapping, Tuple

import rospy

WAITING = 1000
"""Longest queue of one key (messages); beyond it the oldest are dropped."""


class Inbox:
    """Queues messages from rospy's threads, still serialized; only messages that are shown are deserialized.

    `_lock` guards the queues between rospy's threads and the thread that takes from them.

    Args:
        periods: Least time (s) between two takes of a key; 0 for keys that are not in it.
    """

    def __init__(self, periods: Mapping[str, float]) -> None:
        self._periods = periods
        self._due: Dict[str, float] = {}
        self._lock = threading.Lock()
        self._waiting: Dict[str, Deque[Tuple[int, Any]]] = {}
        self._count = 0

    def put(self, key: str, message: Any, every: bool) -> None:
        """Queue a message; unless `every` is set, it replaces those of the same key."""
        with self._lock:
            waiting = self._waiting.setdefault(key, deque(maxlen=WAITING))
            if not every:
                waiting.clear()
            self._count += 1
            waiting.append((self._count, message))

    def take(self, now: float) -> List[Tuple[str, Any]]:
        """Return key and message of all that are queued and due at `now` (s), in the order of their arrival."""
        with self._lock:
            keys = [key for key in self._waiting if now >= self._due.get(key, now)]
            waiting = {key: self._waiting.pop(key) for key in keys}
        for key in keys:
            self._due[key] = now + self._periods.get(key, 0.0)
        came = sorted((count, key, message) for key, messages in waiting.items() for count, message in messages)
        return [(key, message) for _, key, message in came]


def subscribe(topic: str, kind: Any, take: Any) -> rospy.Subscriber:
    """Subscribe with a message type that stays serialized; see `unread`."""
    return rospy.Subscriber(topic, kind, take, queue_size=None, buff_size=1 << 22, tcp_nodelay=True)
