"""Which frame hangs on which: what tf2 takes without a word, and then can look nothing up for good."""

from __future__ import annotations

from typing import Dict, Set

from mbf_relay.ros.common.checks import InvalidMessage


class FrameTree:
    """The frames of a tf buffer, without a loop. Of two relations that contradict each other the first one holds.

    A single message by which 'map' hangs on 'base_link' made each lookup between them fail until the node was
    started again, for tf2 keeps the last relation of every frame.
    """

    def __init__(self) -> None:
        self._parents: Dict[str, str] = {}
        self._fixed: Set[str] = set()  # what /tf_static says of, by child

    def add(self, parent: str, child: str, is_fixed: bool = False) -> None:
        """Hang a frame on another, by their names with or without a leading slash.

        Args:
            parent, child: Their names.
            is_fixed: Whether it never moves there.

        Raises:
            InvalidMessage: The frame would hang on itself.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if is_fixed:
            self._fixed.add(child)
        if self._parents.get(child) == parent:
            return
        frame = parent
        while frame != child and frame in self._parents:
            frame = self._parents[frame]
        if frame == child:
            raise InvalidMessage(f"'{parent}' hangs on '{child}' already; a frame cannot hang on itself")
        self._parents[child] = parent

    def above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return the frames one climbs to from `base` on the way to `frame`, each with whether what it holds is fixed.

        None where `frame` hangs on `base`, or on nothing that `base` does.
        """
        base, frame = base.lstrip("/"), frame.lstrip("/")
        shared = {frame}
        while frame in self._parents:
            frame = self._parents[frame]
            shared.add(frame)
        climbed: Dict[str, bool] = {}
        while base not in shared and base in self._parents:
            climbed[self._parents[base]] = base in self._fixed
            base = self._parents[base]
        return climbed if base in shared else {}
