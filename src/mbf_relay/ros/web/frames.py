"""Transforms for the page: the newest ones, and those at a message's stamp."""

from __future__ import annotations

import math
import threading
from typing import Callable, Dict, List, Optional

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.checks import InvalidMessage, check_frames
from mbf_relay.ros.common.connected_nodes import connected_nodes
from mbf_relay.ros.common.conversions import transform_from_message
from mbf_relay.ros.common.frame_tree import FrameTree
from mbf_relay.ros.common.tf_core import TransformCore

KEPT = 10.0
"""Cache time (s) of transforms of /tf."""
LATEST_STAMP = 2 ** 31
"""Stamps (s) from which on tf2's C++ core aborts the process."""


class Frames:
    """Subscribes to /tf and /tf_static until closed. Lookups can be made from any thread."""

    def __init__(self, changed: Callable[[], None]) -> None:
        """Subscribe; `changed` is called after each message, in rospy's threads."""
        self._changed = changed
        self._lock = threading.Lock()
        self._newest: Dict[str, rospy.Time] = {}  # stamp on /tf by child frame: each node has its own clock
        self._tree = FrameTree(self._is_there)
        self._known = TransformCore(rospy.Duration(KEPT))
        self._subscribers: List[rospy.Subscriber] = []
        self._subscribers = [
            rospy.Subscriber("/tf", TFMessage, self._take, False, queue_size=100, buff_size=1 << 20, tcp_nodelay=True),
            rospy.Subscriber("/tf_static", TFMessage, self._take, True, queue_size=100, buff_size=1 << 20),
        ]

    def close(self) -> None:
        """Unsubscribe."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def lookup(
        self, target: str, source: str, stamp: Optional[rospy.Time] = None, or_newest: bool = True
    ) -> Optional[Pose2D]:
        """Return the transform from one frame to another, None where there is none.

        Args:
            target, source: Frame names, with or without a leading slash.
            stamp: Time of the transform; None for the newest.
            or_newest: Whether to use the newest where there is none at that time.
        """
        try:
            check_frames(target, source)
        except InvalidMessage:
            return None
        target, source = target.lstrip("/"), source.lstrip("/")
        times = [stamp, rospy.Time(0)] if or_newest else [stamp]
        for time in times:
            if time is None or not 0 <= time.secs < LATEST_STAMP:
                continue
            try:
                return transform_from_message(self._known.core.lookup_transform_core(target, source, time).transform)
            except (tf2_py.TransformException, InvalidMessage):
                continue
        return None

    def names(self) -> List[str]:
        """Return the names of all frames in the buffer."""
        lines = self._known.core.all_frames_as_string().splitlines()
        return [line.split()[1] for line in lines if len(line.split()) > 1]

    def _is_there(self, sender: str, is_static: bool) -> bool:
        """Return whether a node is connected as a publisher of /tf_static, or of /tf."""
        return sender in connected_nodes(self._subscribers[int(is_static)]) if self._subscribers else True

    def _take(self, message: TFMessage, is_static: bool) -> None:
        sender, now = message._connection_header.get("callerid", ""), rospy.get_time()
        for transform in message.transforms:
            stamp = transform.header.stamp
            shift = transform.transform.translation
            if not (0 <= stamp.secs < LATEST_STAMP and math.isfinite(shift.x + shift.y + shift.z)):
                continue
            try:
                check_frames(transform.header.frame_id, transform.child_frame_id)
                with self._lock:
                    self._keep(transform, sender, now, is_static)
            except (tf2_py.TransformException, InvalidMessage):
                continue
        self._changed()

    def _keep(self, transform: TransformStamped, sender: str, now: float, is_static: bool) -> None:
        """Keep a transform, under the lock: a static one is published once, and forget() meanwhile would lose it."""
        bygone = self._tree.add(transform.header.frame_id, transform.child_frame_id, sender, now, is_static)
        if bygone:
            self._known.forget(bygone)
        if is_static:
            self._known.set_transform_static(transform, sender)
            return
        stamp, child = transform.header.stamp, transform.child_frame_id.lstrip("/")
        newest = self._newest.get(child, stamp)
        if stamp + rospy.Duration(KEPT) < newest:  # time began anew
            self._known.forget()
            self._newest, newest = {}, stamp
        self._newest[child] = max(stamp, newest)
        self._known.set_transform(transform, sender)
