"""Which recovery behaviour comes next: each one once at every place where something failed."""

from __future__ import annotations

from typing import Callable, List, NamedTuple, Optional, Sequence, Set

from mbf_relay.geometry import Pose2D

NEAR = 0.1
"""Metres within which two failures happened at one place, whatever counts as progress elsewhere."""


class Place(NamedTuple):
    """Where something failed, None where that is not known, and the positions in the list of what was tried there."""

    pose: Optional[Pose2D]
    tried: Set[int]


class Trials:
    """Remembers what was tried where, for one goal.

    The list starts over where the robot has got elsewhere, and goes on where it comes back to. Move Base Flex starts it
    over with every path that is found; a path that cannot be driven then leads through the first behaviours for ever.
    As there are but so many places within reach, a goal that cannot be reached ends.

    Args:
        behaviors: Names, in the order to try.
    """

    def __init__(self, behaviors: Sequence[str]) -> None:
        self._behaviors = tuple(behaviors)
        self._places: List[Place] = []

    def next(self, pose: Optional[Pose2D], progress: float, suits: Callable[[str], bool]) -> Optional[int]:
        """Return the position in the list of what to try now, and count it as tried; None where nothing is left.

        Args:
            pose: Where the robot is; None counts as the place of the last failure.
            progress: Distance (m) to another place.
            suits: Tells of a behaviour whether it can change what failed.
        """
        tried = self._place_of(pose, max(progress, NEAR)).tried
        for index, name in enumerate(self._behaviors):
            if index not in tried and suits(name):
                tried.add(index)
                return index
        return None

    def _place_of(self, pose: Optional[Pose2D], progress: float) -> Place:
        if pose is None and self._places:
            return self._places[-1]
        for place in self._places:
            if place.pose is not None and place.pose.distance_to(pose) < progress:
                return place
        self._places.append(Place(pose, set()))
        return self._places[-1]
