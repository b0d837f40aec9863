"""A tf2 buffer that deserializes /tf only when a transform is asked for: most messages are outdated before that."""

from __future__ import annotations

from typing import Any, Callable, List, Optional

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mbf_relay.ros.common.tf_core import TransformCore


class UnreadTransforms(TFMessage):
    """A TFMessage that is deserialized when its transforms are first read."""

    _bytes = b""
    _read: Optional[List[TransformStamped]] = None

    def deserialize(self, text: bytes) -> UnreadTransforms:
        """Keep the bytes and return the message."""
        self._bytes, self._read = text, None
        return self

    @property
    def transforms(self) -> List[TransformStamped]:
        """The transforms; raises genpy.DeserializationError where they cannot be deserialized."""
        if self._read is None:
            self._read = TFMessage().deserialize(self._bytes).transforms if self._bytes else []
        return self._read

    @transforms.setter
    def transforms(self, transforms: List[TransformStamped]) -> None:
        self._read = transforms


class AttentiveBuffer(tf2_ros.Buffer):
    """A tf2 buffer that, before each lookup, reads the messages received since the last one.

    Args:
        cache_time: Age beyond which transforms of /tf are dropped.

    Attributes:
        attend: Reads them; set by the listener.
        known: The transforms read so far.
    """

    def __init__(self, cache_time: rospy.Duration) -> None:
        self.attend: Callable[[], None] = lambda: None
        self.known = TransformCore(cache_time)
        super().__init__(cache_time)

    def can_transform_core(self, *arguments: Any) -> Any:
        """Answer as tf2 does."""
        self.attend()
        return self.known.core.can_transform_core(*arguments)

    def lookup_transform_core(self, *arguments: Any) -> Any:
        """Answer as tf2 does."""
        self.attend()
        return self.known.core.lookup_transform_core(*arguments)

    def set_transform(self, transform: TransformStamped, sender: str) -> None:
        """Add a transform of /tf."""
        self.known.set_transform(transform, sender)

    def set_transform_static(self, transform: TransformStamped, sender: str) -> None:
        """Add a transform of /tf_static."""
        self.known.set_transform_static(transform, sender)

    def all_frames_as_yaml(self, *arguments: Any) -> Any:
        """Answer as tf2 does."""
        return self.known.core.all_frames_as_yaml(*arguments)
