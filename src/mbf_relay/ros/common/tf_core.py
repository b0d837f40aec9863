"""tf2's BufferCore, replaced by a new one to forget frames: it cannot forget a frame's parent, nor that it is static.
"""

from __future__ import annotations

from typing import Dict, Iterable, Optional, Tuple

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped


class TransformCore:
    """A BufferCore that can forget the transforms of /tf while it keeps those of /tf_static.

    A lookup that is under way in another thread meanwhile ends in the old BufferCore.

    Args:
        cache_time: Age beyond which transforms of /tf are dropped.

    Attributes:
        core: The current BufferCore, for lookups.
    """

    def __init__(self, cache_time: rospy.Duration) -> None:
        self._cache_time = cache_time
        self._fixed: Dict[str, Tuple[TransformStamped, str]] = {}  # static transform and its sender, by child frame
        self._told: Dict[str, rospy.Time] = {}  # stamp of the last transform of /tf, by child frame
        self.core = tf2_py.BufferCore(cache_time)

    def set_transform(self, transform: TransformStamped, sender: str) -> None:
        """Add a transform of /tf; one with the same stamp as the last of its frame is ignored.

        tf2 ignores it, too, but prints TF_REPEATED_DATA to stderr each time, which blocks the process where the
        terminal blocks.
        """
        stamp = transform.header.stamp
        if self._told.get(transform.child_frame_id) != stamp:
            self._told[transform.child_frame_id] = stamp
            self.core.set_transform(transform, sender)

    def set_transform_static(self, transform: TransformStamped, sender: str) -> None:
        """Add a transform of /tf_static."""
        self._fixed[transform.child_frame_id.lstrip("/")] = transform, sender
        self.core.set_transform_static(transform, sender)

    def forget(self, children: Iterable[str] = ()) -> None:
        """Forget all transforms of /tf, and those of /tf_static of the given child frames."""
        for child in children:
            self._fixed.pop(child.lstrip("/"), None)
        self._told.clear()
        core = tf2_py.BufferCore(self._cache_time)
        for transform, sender in self._fixed.values():
            core.set_transform_static(transform, sender)
        self.core = core

    def fixed(self, child: str) -> Optional[TransformStamped]:
        """Return the static transform of a child frame, None where it has none."""
        found = self._fixed.get(child.lstrip("/"))
        return None if found is None else found[0]
