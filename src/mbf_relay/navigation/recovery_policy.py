"""Choice of the next recovery behaviour: which failures a behaviour can change, and which were tried at this place.

mbf_abstract_nav's MoveBaseAction recovers from every failed plan, and from every failed drive but five outcomes
(actionGetPathDone, actionExePathDone). Here failed plans are judged like drives: where neither new sensor data nor
another pose of the robot can change a failure, the goal ends at once with the failure's own code and text. For drives,
CANCELED, STOPPED and MAP_ERROR are added to Move Base Flex's five outcomes.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set

from mbf_relay.geometry import Pose2D
from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.outcomes import ControlOutcome, PlanOutcome
from mbf_relay.recovery.recovery import Recovery


class Recoverable(Enum):
    """What can change a failure; the value explains it."""

    NO = "nothing that a recovery behaviour does"
    BY_CLEARING = "obstacles forgotten and seen anew; the robot's place does not matter"
    BY_SEEING = "obstacles seen anew, or from elsewhere; which way the robot faces does not matter"
    BY_MOVING = "obstacles seen anew, or the robot elsewhere or turned"


class RecoveryPolicy(NamedTuple):
    """What can change a failure, and the reason."""

    recoverable: Recoverable
    reason: str


NO, BY_CLEARING, BY_SEEING, BY_MOVING = Recoverable

PLANNING: Dict[Enum, RecoveryPolicy] = {
    PlanOutcome.FAILURE: RecoveryPolicy(BY_MOVING, "a planner's word for anything, most often for no path"),
    PlanOutcome.CANCELED: RecoveryPolicy(NO, "somebody called it off"),
    PlanOutcome.INVALID_START: RecoveryPolicy(NO, "a robot whose pose is no pose must not be moved by it"),
    PlanOutcome.INVALID_GOAL: RecoveryPolicy(NO, "what was asked for is wrong in itself"),
    PlanOutcome.BLOCKED_START: RecoveryPolicy(
        BY_MOVING, "what is marked under the robot may be gone, or the robot may leave it"
    ),
    PlanOutcome.BLOCKED_GOAL: RecoveryPolicy(
        BY_CLEARING, "what is marked on the goal may be gone, wherever the robot is"
    ),
    PlanOutcome.NO_PATH_FOUND: RecoveryPolicy(
        BY_SEEING, "what is marked across the way may be gone, or look otherwise from elsewhere"
    ),
    PlanOutcome.PAT_EXCEEDED: RecoveryPolicy(
        BY_CLEARING, "a planner that thinks too long may be quicker with fewer obstacles"
    ),
    PlanOutcome.EMPTY_PATH: RecoveryPolicy(BY_MOVING, "how some planners say that there is no path"),
    PlanOutcome.TF_ERROR: RecoveryPolicy(
        NO, "waited for already: the frame does not exist, or the robot's place is unknown"
    ),
    PlanOutcome.NOT_INITIALIZED: RecoveryPolicy(NO, "a plugin or costmap that is not ready was waited for already"),
    PlanOutcome.INVALID_PLUGIN: RecoveryPolicy(NO, "there is no such planner"),
    PlanOutcome.INTERNAL_ERROR: RecoveryPolicy(NO, "a fault in the planner, as with a drive's in Move Base Flex"),
    PlanOutcome.OUT_OF_MAP: RecoveryPolicy(
        NO, "no behaviour makes the map larger; one that follows the robot was waited for"
    ),
    PlanOutcome.MAP_ERROR: RecoveryPolicy(
        NO, "the map is missing, too old or too large, and moving on it would be blind"
    ),
    PlanOutcome.STOPPED: RecoveryPolicy(NO, "somebody stopped the planner"),
}
"""Policy for each outcome of get_path."""

DRIVING: Dict[Enum, RecoveryPolicy] = {
    ControlOutcome.FAILURE: RecoveryPolicy(BY_MOVING, "a controller's word for anything"),
    ControlOutcome.CANCELED: RecoveryPolicy(NO, "somebody called it off"),
    ControlOutcome.NO_VALID_CMD: RecoveryPolicy(BY_MOVING, "obstacles round the robot leave no velocity"),
    ControlOutcome.PAT_EXCEEDED: RecoveryPolicy(BY_MOVING, "it found no velocity for too long"),
    ControlOutcome.COLLISION: RecoveryPolicy(
        BY_MOVING, "what is marked under the robot may be gone, or the robot may leave it"
    ),
    ControlOutcome.OSCILLATION: RecoveryPolicy(BY_MOVING, "from elsewhere the way may be clear"),
    ControlOutcome.ROBOT_STUCK: RecoveryPolicy(BY_MOVING, "wheels that turn in vain ahead may grip back"),
    ControlOutcome.MISSED_GOAL: RecoveryPolicy(BY_MOVING, "a new path may end nearer to it"),
    ControlOutcome.MISSED_PATH: RecoveryPolicy(BY_MOVING, "a new path begins where the robot is"),
    ControlOutcome.BLOCKED_GOAL: RecoveryPolicy(
        BY_MOVING, "what is marked on the goal may be gone, and room to turn is a matter of place"
    ),
    ControlOutcome.BLOCKED_PATH: RecoveryPolicy(
        BY_MOVING, "what is marked on the path may be gone, or another path lead round it"
    ),
    ControlOutcome.INVALID_PATH: RecoveryPolicy(NO, "the planner's fault, as in Move Base Flex"),
    ControlOutcome.TF_ERROR: RecoveryPolicy(
        NO, "tf_timeout was waited already, and a robot must not move without a pose"
    ),
    ControlOutcome.NOT_INITIALIZED: RecoveryPolicy(NO, "as in Move Base Flex"),
    ControlOutcome.INVALID_PLUGIN: RecoveryPolicy(NO, "there is no such controller"),
    ControlOutcome.INTERNAL_ERROR: RecoveryPolicy(NO, "a fault in the controller"),
    ControlOutcome.OUT_OF_MAP: RecoveryPolicy(BY_MOVING, "the local map goes with the robot"),
    ControlOutcome.MAP_ERROR: RecoveryPolicy(NO, "the map is missing or unusable, and moving on it would be blind"),
    ControlOutcome.STOPPED: RecoveryPolicy(NO, "somebody stopped the controller"),
}
"""Policy for each outcome of exe_path."""

POLICIES: Dict[Enum, RecoveryPolicy] = {
    **PLANNING,
    **DRIVING,
    NavigateOutcome.OSCILLATION: RecoveryPolicy(BY_MOVING, "from elsewhere the way may be clear"),
}
"""Policy for every outcome that move_base may have to recover from."""


def recoverable(outcome: Enum, cause: Optional[Enum] = None) -> Recoverable:
    """Return what can change a failure.

    Args:
        outcome: Outcome of planning or driving.
        cause: With PAT_EXCEEDED, the outcome of the last failed try, which is judged instead; else None.
    """
    return POLICIES[outcome if cause is None else cause].recoverable


def can_change(change: Recoverable, behavior: Recovery, costmap: Any) -> bool:
    """Return whether a behaviour can change a failure.

    A behaviour that drives elsewhere cannot if the robot's place does not matter (BY_CLEARING). One that only turns the
    sensors cannot if the heading does not matter and they see all round already.

    Args:
        change: What can change the failure.
        behavior: The behaviour.
        costmap: `sees_all_round` says whether the sensors do.
    """
    if change in (NO, BY_MOVING):
        return change is BY_MOVING
    if behavior.leaves_place:
        return change is BY_SEEING
    return not (behavior.only_looks_round and costmap.sees_all_round)


NEAR = 0.1
"""Smallest distance (m) between two places; oscillation_distance may be larger."""


class TriedHere(NamedTuple):
    """A place where something failed (None if the pose was unknown), and the indices of the behaviours tried there."""

    pose: Optional[Pose2D]
    tried: Set[int]


class TriedBehaviors:
    """Remembers which behaviours were tried at which places, for one goal.

    The list starts over at each new place, and goes on where the robot returns to one. Move Base Flex starts it over
    with every path that is found; with a path that cannot be driven, it repeats the first behaviours for ever. Here a
    goal that cannot be reached ends, since the number of places within reach is finite. When odometry becomes valid
    again, all may be tried again: in the meantime the costmaps were filled with obstacles at wrong places.

    Args:
        behaviors: Names, in the order to try.
    """

    def __init__(self, behaviors: Sequence[str]) -> None:
        self._behaviors = tuple(behaviors)
        self._places: List[TriedHere] = []
        self._last: Optional[TriedHere] = None
        self._was_certain = True

    def next(
        self, pose: Optional[Pose2D], progress: float, suits: Callable[[str], bool], is_certain: bool = True
    ) -> Optional[int]:
        """Return the index of the behaviour to try now, and mark it as tried; None where nothing is left.

        Args:
            pose: The robot's pose; None counts as the place of the last failure.
            progress: Distance (m) from which on a pose is another place.
            suits: Returns whether the behaviour of a name can change the failure.
            is_certain: Whether odometry is valid.
        """
        if is_certain and not self._was_certain:
            self._places.clear()
            self._last = None
        self._was_certain = is_certain
        self._last = self._place_of(pose, max(progress, NEAR))
        tried = self._last.tried
        for index, name in enumerate(self._behaviors):
            if index not in tried and suits(name):
                tried.add(index)
                return index
        return None

    def _place_of(self, pose: Optional[Pose2D], progress: float) -> TriedHere:
        if pose is None and self._last is not None:
            return self._last
        for place in self._places:
            if pose is not None and place.pose is not None and place.pose.distance_to(pose) < progress:
                return place
        self._places.append(TriedHere(pose, set()))
        return self._places[-1]
