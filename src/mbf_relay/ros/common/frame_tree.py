"""Which frame hangs on which: what tf2 takes without a word, and then can look nothing up for good."""

from __future__ import annotations

from typing import Dict

from mbf_relay.ros.common.checks import InvalidMessage


class FrameTree:
    """The frames of a tf buffer, without a loop. Of two relations that contradict each other the first one holds.

    A single message by which 'map' hangs on 'base_link' made each lookup between them fail until the node was
    started again, for tf2 keeps the last relation of every frame.
    """

    def __init__(self) -> None:
        self._parents: Dict[str, str] = {}

    def add(self, parent: str, child: str) -> None:
        """Hang a frame on another, by their names with or without a leading slash.

        Raises:
            InvalidMessage: The frame would hang on itself.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if self._parents.get(child) == parent:
            return
        frame = parent
        while frame != child and frame in self._parents:
            frame = self._parents[frame]
        if frame == child:
            raise InvalidMessage(f"'{parent}' hangs on '{child}' already; a frame cannot hang on itself")
        self._parents[child] = parent
