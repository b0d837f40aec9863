"""Which failures a recovery behaviour can change: one table over all outcomes, each with its reason.

mbf_abstract_nav's MoveBaseAction recovers from every failed plan, and from every failed drive but five
(actionGetPathDone, actionExePathDone). Here a failed plan is judged as a drive is: where neither a fresh look at the
surroundings nor another place of the robot can change a failure, its goal ends at once, with the failure's own code and
text, and the robot does not move for nothing. Three outcomes of a drive are added to Move Base Flex's five: CANCELED,
STOPPED and MAP_ERROR.
"""

from __future__ import annotations

from enum import Enum
from typing import Dict, NamedTuple, Optional

from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.outcomes import ControlOutcome, PlanOutcome


class Remedy(Enum):
    """What can change a failure."""

    NONE = "nothing that a recovery behaviour does"
    LOOK = "obstacles forgotten and seen anew; the robot's place does not matter"
    MOVE = "obstacles seen anew, or the robot elsewhere"


class Verdict(NamedTuple):
    """What can change a failure, and why that is so."""

    remedy: Remedy
    reason: str


NONE, LOOK, MOVE = Remedy.NONE, Remedy.LOOK, Remedy.MOVE

PLANNING: Dict[PlanOutcome, Verdict] = {
    PlanOutcome.FAILURE: Verdict(MOVE, "a planner's word for anything, most often for no path"),
    PlanOutcome.CANCELED: Verdict(NONE, "somebody called it off"),
    PlanOutcome.INVALID_START: Verdict(NONE, "a robot whose pose is no pose must not be moved by it"),
    PlanOutcome.INVALID_GOAL: Verdict(NONE, "what was asked for is wrong in itself"),
    PlanOutcome.BLOCKED_START: Verdict(MOVE, "what is marked under the robot may be gone, or the robot may leave it"),
    PlanOutcome.BLOCKED_GOAL: Verdict(LOOK, "what is marked on the goal may be gone, wherever the robot is"),
    PlanOutcome.NO_PATH_FOUND: Verdict(MOVE, "what is marked across the way may be gone, or look otherwise from elsewhere"),
    PlanOutcome.PAT_EXCEEDED: Verdict(LOOK, "a planner that thinks too long may be quicker with fewer obstacles"),
    PlanOutcome.EMPTY_PATH: Verdict(MOVE, "how some planners say that there is no path"),
    PlanOutcome.TF_ERROR: Verdict(NONE, "waited for already: the frame does not exist, or the robot's place is unknown"),
    PlanOutcome.NOT_INITIALIZED: Verdict(NONE, "a plugin or costmap that is not ready was waited for already"),
    PlanOutcome.INVALID_PLUGIN: Verdict(NONE, "there is no such planner"),
    PlanOutcome.INTERNAL_ERROR: Verdict(NONE, "a fault in the planner, as with a drive's in Move Base Flex"),
    PlanOutcome.OUT_OF_MAP: Verdict(NONE, "no behaviour makes the map larger; one that follows the robot was waited for"),
    PlanOutcome.MAP_ERROR: Verdict(NONE, "the map is missing, too old or too large, and moving on it would be blind"),
    PlanOutcome.STOPPED: Verdict(NONE, "somebody stopped the planner"),
}
"""Outcomes of get_path."""

DRIVING: Dict[ControlOutcome, Verdict] = {
    ControlOutcome.FAILURE: Verdict(MOVE, "a controller's word for anything"),
    ControlOutcome.CANCELED: Verdict(NONE, "somebody called it off"),
    ControlOutcome.NO_VALID_CMD: Verdict(MOVE, "obstacles round the robot leave no velocity"),
    ControlOutcome.PAT_EXCEEDED: Verdict(MOVE, "it found no velocity for too long"),
    ControlOutcome.COLLISION: Verdict(MOVE, "what is marked under the robot may be gone, or the robot may leave it"),
    ControlOutcome.OSCILLATION: Verdict(MOVE, "from elsewhere the way may be clear"),
    ControlOutcome.ROBOT_STUCK: Verdict(MOVE, "wheels that turn in vain ahead may grip back"),
    ControlOutcome.MISSED_GOAL: Verdict(MOVE, "a new path may end nearer to it"),
    ControlOutcome.MISSED_PATH: Verdict(MOVE, "a new path begins where the robot is"),
    ControlOutcome.BLOCKED_GOAL: Verdict(MOVE, "what is marked on the goal may be gone, and room to turn is a matter of place"),
    ControlOutcome.BLOCKED_PATH: Verdict(MOVE, "what is marked on the path may be gone, or another path lead round it"),
    ControlOutcome.INVALID_PATH: Verdict(NONE, "the planner's fault, as in Move Base Flex"),
    ControlOutcome.TF_ERROR: Verdict(NONE, "tf_timeout was waited already, and a robot must not move without a pose"),
    ControlOutcome.NOT_INITIALIZED: Verdict(NONE, "as in Move Base Flex"),
    ControlOutcome.INVALID_PLUGIN: Verdict(NONE, "there is no such controller"),
    ControlOutcome.INTERNAL_ERROR: Verdict(NONE, "a fault in the controller"),
    ControlOutcome.OUT_OF_MAP: Verdict(MOVE, "the local map goes with the robot"),
    ControlOutcome.MAP_ERROR: Verdict(NONE, "the map is missing or unusable, and moving on it would be blind"),
    ControlOutcome.STOPPED: Verdict(NONE, "somebody stopped the controller"),
}
"""Outcomes of exe_path."""

VERDICTS: Dict[Enum, Verdict] = {
    **PLANNING, **DRIVING, NavigateOutcome.OSCILLATION: Verdict(MOVE, "from elsewhere the way may be clear"),
}
"""Every outcome that move_base may have to recover from."""


def remedy_for(outcome: Enum, cause: Optional[Enum] = None) -> Remedy:
    """Return what can change a failure.

    Args:
        outcome: How planning or driving ended.
        cause: What had failed again and again where it ended because patience was over; that decides then.
    """
    return VERDICTS[outcome if cause is None else cause].remedy
