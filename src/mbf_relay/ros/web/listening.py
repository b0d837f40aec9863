"""A robot's topics and frames, listened to while anybody looks."""

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
    """Subscribes to what is wanted and published.

    `open`, `reconcile` and `close` talk to the master, may block, and are called from the one thread that does nothing
    else. What they bring stands in `inbox` and in the frames, each with a lock of its own.

    Args:
        namespace: The robot's, with a slash at both ends.
        base_frame: The robot's frame, where no amcl of its namespace names one.
        changed: Called from any thread when something came.
    """

    def __init__(self, namespace: str, base_frame: str, changed: Callable[[], None]) -> None:
        self.namespace, self.base_frame = namespace, base_frame
        self.inbox = Inbox({key: source.period for key, source in SOURCES.items()})
        self._changed = changed
        self._frames: Optional[Frames] = None
        self._subscribers: Dict[Tuple[str, str], rospy.Subscriber] = {}

    def open(self) -> None:
        """Begin to listen to frames; topics follow with `reconcile`."""
        self.base_frame = str(rospy.get_param(f"{self.namespace}amcl/base_frame_id", self.base_frame))
        self._frames = Frames(self._changed)

    def reconcile(self, shown: FrozenSet[str], published: Mapping[str, str]) -> None:
        """Listen to what is shown and published, and to nothing else.

        Args:
            shown: The layers that somebody looks at.
            published: Types of the topics that somebody publishes.
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
        """Stop listening."""
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
        """Return the frames that are known."""
        frames = self._frames
        return [] if frames is None else frames.names()

    def _receive(self, key: str, message: Any) -> None:
        self.inbox.put(key, message, SOURCES[key].every)
        self._changed()
