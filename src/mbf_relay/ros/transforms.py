"""Frames: tf lookups as planar poses, with errors that name the stale frame and its age."""

from __future__ import annotations

import threading
from typing import Any, List, Optional

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.conversions import header, transform_from_message, transform_to_message


class Transforms:
    """A tf buffer that gives planar poses."""

    def __init__(self, cache_time: float = 10.0) -> None:
        self.buffer = tf2_ros.Buffer(rospy.Duration(cache_time))
        self._listener = tf2_ros.TransformListener(self.buffer, buff_size=1 << 20, tcp_nodelay=True)

    def close(self) -> None:
        """Stop listening."""
        self._listener.unregister()

    def lookup(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None,
    ) -> Pose2D:
        """Return the transform that takes poses in `source_frame` to `target_frame`.

        Args:
            target_frame, source_frame: Frame names, with or without a leading slash.
            stamp: Time (s) to look at; the newest where None.
            timeout: Time (s) to wait for it; call with 0 from callbacks.
            max_age: Age (s) beyond which the newest relation is refused; no limit where None.

        Raises:
            TransformError: Naming the frames, and the age of the relation where it is too old.
        """
        return transform_from_message(self.lookup_message(target_frame, source_frame, stamp, timeout, max_age).transform)

    def lookup_message(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None,
    ) -> TransformStamped:
        """Return the transform as a message, for whoever needs all three dimensions; arguments as for `lookup`."""
        if not target_frame.strip("/") or not source_frame.strip("/"):
            raise TransformError(f"no transform from '{source_frame}' to '{target_frame}': a frame must have a name")
        time = rospy.Time(0) if stamp is None else rospy.Time.from_sec(stamp)
        frames = target_frame.lstrip("/"), source_frame.lstrip("/")
        try:
            if timeout > 0.0:  # else the look whether it is there would be one more, forty times a second
                self.buffer.can_transform(*frames, time, rospy.Duration(timeout))
            message = self.buffer.lookup_transform_core(*frames, time)
        except tf2_ros.TransformException as error:
            raise TransformError(
                f"no transform from '{source_frame}' to '{target_frame}': {' '.join(str(error).split())}"
            ) from error
        age = (rospy.get_rostime() - message.header.stamp).to_sec()
        if max_age is not None and message.header.stamp.to_sec() > 0.0 and age > max_age:
            raise TransformError(
                f"the transform from '{source_frame}' to '{target_frame}' is {age:.2f} s old; at most {max_age:.2f} s allowed"
            )
        return message

    def can_transform(self, target_frame: str, source_frame: str, stamp: float) -> bool:
        """Tell whether the relation is known at `stamp` (s)."""
        return bool(
            self.buffer.can_transform(
                target_frame.lstrip("/"), source_frame.lstrip("/"), rospy.Time.from_sec(stamp), rospy.Duration(0)
            )
        )


class TransformPublisher:
    """Sends planar transforms on /tf; one per process, whatever threads use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=100, tcp_nodelay=True)

    def send(self, parent: str, child: str, child_in_parent: Pose2D, stamp: Any) -> None:
        """Publish one transform; `stamp` in seconds or as rospy.Time."""
        self.send_messages([TransformStamped(header(parent, stamp), child, transform_to_message(child_in_parent))])

    def send_messages(self, messages: List[TransformStamped]) -> None:
        """Publish ready messages in one."""
        with self._lock:
            self._publisher.publish(TFMessage(messages))
