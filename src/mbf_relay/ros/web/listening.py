"""Subscriptions to a robot's topics and frames, while a browser shows them."""

from __future__ import annotations

from functools import partial
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Tuple

import rospy

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.unread import unread
from mbf_relay.ros.web.frames import Frames
from mbf_relay.ros.web.inbox import Inbox, subscribe
from mbf_relay.ros.web.sources import SOURCES, topics_of

UNREAD = {key: unread(source.message) for key, source in SOURCES.items()}


class Listening:
    """Subscribes to the topics that are shown and published.

    `open`, `reconcile` and `close` call the ROS master, may block, and are called only from the hub's graph thread.
    Messages go to `inbox` and transforms to Frames; each has its own lock.

    Args:
        namespace: The robot's namespace, with a slash at both ends.
        base_frame: The robot's base frame, unless amcl in its namespace has a base_frame_id.
        changed: Called from any thread after each message.
    """

    def __init__(self, namespace: str, base_frame: str, changed: Callable[[], None]) -> None:
        self.namespace, self.base_frame = namespace, base_frame
        self.inbox = Inbox({key: source.period for key, source in SOURCES.items()})
        self._changed = changed
        self._frames: Optional[Frames] = None
        self._subscribers: Dict[Tuple[str, str], rospy.Subscriber] = {}

    def open(self) -> None:
        """Read the base frame and subscribe to transforms; other topics follow in `reconcile`."""
        self.base_frame = str(rospy.get_param(f"{self.namespace}amcl/base_frame_id", self.base_frame))
        self._frames = Frames(self._changed)

    def reconcile(self, shown: FrozenSet[str], published: Mapping[str, str]) -> None:
        """Subscribe to the topics of the layers shown, where they are published, and unsubscribe from all others.

        Args:
            shown: Names of the layers that some browser shows.
            published: Message types of all published topics, by topic.
        """
        desired = {
            (key, topic) for key, source in SOURCES.items() if not source.layer or source.layer in shown
            for topic in topics_of(source, self.namespace, published)
        }
        for link in set(self._subscribers) - desired:
            self._subscribers.pop(link).unregister()
        for key, topic in sorted(desired - set(self._subscribers)):
            self._subscribers[key, topic] = subscribe(topic, UNREAD[key], partial(self._receive, key))

    def close(self) -> None:
        """Unsubscribe from all topics."""
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self._subscribers.clear()
        if self._frames is not None:
            self._frames.close()
            self._frames = None

    def lookup(self, target: str, source: str, stamp: Any = None, or_newest: bool = True) -> Optional[Pose2D]:
        """Return a transform; arguments as for `Frames.lookup`."""
        frames = self._frames
        return None if frames is None else frames.lookup(target, source, stamp, or_newest)

    def frame_names(self) -> List[str]:
        """Return the names of the known frames."""
        frames = self._frames
        return [] if frames is None else frames.names()

    def _receive(self, key: str, message: Any) -> None:
        self.inbox.put(key, message, SOURCES[key].every)
        self._changed()
