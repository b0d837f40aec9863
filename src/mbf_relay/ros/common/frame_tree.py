"""Which frame hangs on which, and who says so: tf2 believes whoever spoke last, and keeps it for good."""

from __future__ import annotations

from typing import Callable, Dict, List

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.senders import AT_ONCE


class ContestedFrame(InvalidMessage):
    """Somebody else says already where a frame is."""


class Relation:
    """What is known of a frame: what it hangs on, whether for good (by /tf_static), who says so, and since when (s)."""

    __slots__ = ("heard_at", "is_fixed", "parent", "sender")

    def __init__(self, parent: str, sender: str, is_fixed: bool, heard_at: float) -> None:
        self.parent, self.sender, self.is_fixed, self.heard_at = parent, sender, is_fixed, heard_at


class FrameTree:
    """The frames of a tf buffer, without a loop, each of which one node tells of.

    Who told of a frame first goes on to, as long as it is there: connected, and on /tf heard from within two seconds.
    What others say of that frame meanwhile is refused, be it another parent or another place. One message by which
    'base_scan' hung on 'map' left the nodes without a lidar until they were started again; with two broadcasters of
    one transform, poses jumped between what they said.

    Args:
        is_there: Tells whether a node of that name is connected to /tf_static (where True) or /tf.
    """

    def __init__(self, is_there: Callable[[str, bool], bool]) -> None:
        self._is_there = is_there
        self._relations: Dict[str, Relation] = {}  # by child

    def add(self, parent: str, child: str, sender: str, now: float, is_fixed: bool = False) -> List[str]:
        """Hang a frame on another; return the frames of which tf2 must forget what it knew to follow.

        Args:
            parent, child: Their names, with or without a leading slash.
            sender: Who says so.
            now: When it came (s).
            is_fixed: Whether it never moves there.

        Raises:
            ContestedFrame: Somebody else tells of this frame.
            InvalidMessage: The frame would hang on itself.
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
        turned = held is not None and held.is_fixed != is_fixed  # tf2 never turns one kind into the other
        return [*bygone, child] if bygone or turned else []

    def _break_loop(self, parent: str, child: str, now: float) -> List[str]:
        """Forget what is said by nobody any more where a relation would close a loop with it; return of which frames.
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
        """Return what is known of a frame and of all that it hangs on, by name, itself first."""
        line: Dict[str, Relation] = {}
        frame = frame.lstrip("/")
        while frame in self._relations:
            line[frame] = self._relations[frame]
            frame = line[frame].parent
        return line

    def above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return the frames one climbs to from `base` on the way to `frame`, each with whether what it holds is fixed.

        None where `frame` hangs on `base`, or on nothing that `base` does.
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
