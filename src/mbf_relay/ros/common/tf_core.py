"""tf2's buffer, made anew where it has to forget something: it keeps the last relation of every frame, and its kind."""

from __future__ import annotations

from typing import Dict, Iterable, Optional, Tuple

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped


class TransformCore:
    """The relations of frames, of which those of /tf_static outlive the rest.

    A lookup of another thread that is under way goes on in what was there before.

    Args:
        cache_time: Age (s) beyond which nothing of /tf is kept.

    Attributes:
        core: tf2's buffer, for lookups.
    """

    def __init__(self, cache_time: rospy.Duration) -> None:
        self._cache_time = cache_time
        self._fixed: Dict[str, Tuple[TransformStamped, str]] = {}  # with who sent it, by child
        self._told: Dict[str, rospy.Time] = {}  # the time of the last relation of /tf, by child
        self.core = tf2_py.BufferCore(cache_time)

    def set_transform(self, transform: TransformStamped, sender: str) -> None:
        """Take a relation of /tf; one of a time that is known changes nothing.

        tf2 would say so for each, past the log, and hold the whole process where the terminal takes no lines.
        """
        stamp = transform.header.stamp
        if self._told.get(transform.child_frame_id) != stamp:
            self._told[transform.child_frame_id] = stamp
            self.core.set_transform(transform, sender)

    def set_transform_static(self, transform: TransformStamped, sender: str) -> None:
        """Take a relation of /tf_static."""
        self._fixed[transform.child_frame_id.lstrip("/")] = transform, sender
        self.core.set_transform_static(transform, sender)

    def forget(self, children: Iterable[str] = ()) -> None:
        """Forget what /tf told, and what /tf_static told of some frames."""
        for child in children:
            self._fixed.pop(child.lstrip("/"), None)
        self._told.clear()
        core = tf2_py.BufferCore(self._cache_time)
        for transform, sender in self._fixed.values():
            core.set_transform_static(transform, sender)
        self.core = core

    def fixed(self, child: str) -> Optional[TransformStamped]:
        """Return what /tf_static told of a frame, None where it told nothing."""
        found = self._fixed.get(child.lstrip("/"))
        return None if found is None else found[0]
