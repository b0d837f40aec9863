"""The tree of tf frames, and which node publishes each: tf2 itself takes whatever was published last."""

from __future__ import annotations

from typing import Callable, Dict, List

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.senders import AT_ONCE


class ContestedFrame(InvalidMessage):
    """Another node publishes the transform of this frame already."""


class Relation:
    """A frame's parent, the node that publishes it, whether on /tf_static, and when it was last received (ROS time, s).
    """

    __slots__ = ("heard_at", "is_fixed", "parent", "sender")

    def __init__(self, parent: str, sender: str, is_fixed: bool, heard_at: float) -> None:
        self.parent, self.sender, self.is_fixed, self.heard_at = parent, sender, is_fixed, heard_at


class FrameTree:
    """The frames of a tf buffer: a tree without loops, in which one node publishes each frame.

    The first node that publishes a frame keeps it while it is alive: connected, and on /tf heard within the last two
    seconds. Transforms of that frame by other nodes are refused meanwhile. Without this, one message with 'map' as
    parent of 'base_scan' left nodes without a lidar until they were restarted, and with two broadcasters of one
    transform, poses jumped between the two.

    Args:
        is_there: Called with a node's name and whether /tf_static is meant, else /tf; returns whether it is connected.
    """

    def __init__(self, is_there: Callable[[str, bool], bool]) -> None:
        self._is_there = is_there
        self._relations: Dict[str, Relation] = {}  # by child

    def add(self, parent: str, child: str, sender: str, now: float, is_fixed: bool = False) -> List[str]:
        """Add a transform's frames, or note that they are still published.

        Args:
            parent, child: Names of the frames, with or without a leading slash.
            sender: Name of the node that publishes the transform.
            now: ROS time (s) at which it was received.
            is_fixed: Whether it came on /tf_static.

        Returns:
            The frames that the tf2 buffer has to forget before it can take this transform; mostly none.

        Raises:
            ContestedFrame: Another node that is alive publishes this frame.
            InvalidMessage: The tree would get a loop.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        held = self._relations.get(child)
        if held is not None and held.sender != sender and self._is_alive(held, now):
            raise ContestedFrame(
                f"{sender} says that '{child}' hangs on '{parent}', while {held.sender} says where it is on "
                f"'{held.parent}'; who came first is believed as long as it is there, and only one of them may be left")
        if held is not None and held.parent == parent and held.is_fixed == is_fixed:
            held.sender, held.heard_at = sender, now
            return []
        bygone = self._break_loop(parent, child, now)
        self._relations[child] = Relation(parent, sender, is_fixed, now)
        turned = held is not None and held.is_fixed != is_fixed  # tf2 never makes a static frame of a moving one
        return [*bygone, child] if bygone or turned else []

    def _break_loop(self, parent: str, child: str, now: float) -> List[str]:
        """Remove relations of dead publishers that would form a loop with the new one; return their child frames.

        Raises:
            InvalidMessage: All relations of the loop are of nodes that are alive.
        """
        above: List[str] = []
        frame = parent
        while frame != child and frame in self._relations:
            above.append(frame)
            frame = self._relations[frame].parent
        if frame != child:
            return []
        bygone = [name for name in above if not self._is_alive(self._relations[name], now)]
        if not bygone:
            raise InvalidMessage(f"'{parent}' hangs on '{child}' already; a frame cannot hang on itself")
        for name in bygone:
            del self._relations[name]
        return bygone

    def _is_alive(self, relation: Relation, now: float) -> bool:
        heard = relation.is_fixed or 0.0 <= now - relation.heard_at <= AT_ONCE
        return heard and self._is_there(relation.sender, relation.is_fixed)

    def line(self, frame: str) -> Dict[str, Relation]:
        """Return the relations from a frame up to the root of its tree, by child frame, the frame itself first."""
        line: Dict[str, Relation] = {}
        frame = frame.lstrip("/")
        while frame in self._relations:
            line[frame] = self._relations[frame]
            frame = line[frame].parent
        return line

    def above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return the ancestors of `base` up to the nearest one that it shares with `frame`.

        By name, each with whether the transform to it, from the frame below it, is static. Empty where `frame` is below
        `base`, or in another tree.
        """
        base, frame = base.lstrip("/"), frame.lstrip("/")
        shared = {frame, *(relation.parent for relation in self.line(frame).values())}
        climbed: Dict[str, bool] = {}
        for name, relation in self.line(base).items():
            if name in shared:
                break
            climbed[relation.parent] = relation.is_fixed
            base = relation.parent
        return climbed if base in shared else {}
