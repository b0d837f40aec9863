"""What can be asked of navigation and what it answers: the four actions' goals, feedback and results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Optional, Tuple

from mbf_relay.control.state import GoalTolerance
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.refused_places import Toll
from mbf_relay.outcomes import ControlOutcome, PlanOutcome, RecoveryOutcome
from mbf_relay.planning.path import Path


class FramedPose(NamedTuple):
    """A pose and the frame it is given in."""

    pose: Pose2D
    frame: str


@dataclass(frozen=True)
class PlanGoal:
    """Find a path.

    Attributes:
        target: Where to.
        start: Where from; the robot's pose where None.
        tolerance: Distance (m) by which the target may be missed.
        planner: Name of the planner; the first one where empty.
        slot: Goals in one slot replace each other.
        tolls: What to go round where that is worth it, in the global frame.
    """

    target: FramedPose
    start: Optional[FramedPose] = None
    tolerance: float = 0.0
    planner: str = ""
    slot: int = 0
    tolls: Tuple[Toll, ...] = ()


@dataclass(frozen=True)
class PlanResult:
    """A path, or why there is none; `path` is None unless `outcome` is SUCCESS.

    `cause` is what had failed last where patience was over, None where the planner had not returned.
    """

    outcome: PlanOutcome
    message: str
    path: Optional[Path] = None
    cost: float = 0.0
    cause: Optional[PlanOutcome] = None


@dataclass(frozen=True)
class FollowGoal:
    """Drive along a path.

    Attributes:
        path: The path.
        controller: Name of the controller; the first one where empty.
        slot: Goals in one slot replace each other.
        tolerance: When to call it arrived; the controller's own judgement where None, and where a part of it is 0.
        same_goal: The path leads where the replaced one did; found out by comparing their ends where None.
    """

    path: Path
    controller: str = ""
    slot: int = 0
    tolerance: Optional[GoalTolerance] = None
    same_goal: Optional[bool] = None


@dataclass(frozen=True)
class FollowFeedback:
    """One control cycle.

    Attributes:
        outcome: SUCCESS with a velocity, otherwise why there was none.
        message: What a person should know of it.
        pose: The robot.
        velocity: What was commanded last.
        distance, angle: What is left (m, rad) to the path's last pose.
        late: Seconds by which the robot does late what it is told, 0.0 where that is little or not known.
        refused: Whether the controller found no velocity; False also where it could not be asked.
    """

    outcome: ControlOutcome
    message: str
    pose: Optional[FramedPose] = None
    velocity: Twist2D = STOP
    distance: float = math.inf
    angle: float = math.inf
    late: float = 0.0
    refused: bool = False

    @property
    def is_unasked(self) -> bool:
        """Whether the controller could not be asked, as without a pose; the robot stood."""
        return self.outcome is not ControlOutcome.SUCCESS and not self.refused


@dataclass(frozen=True)
class FollowResult:
    """How a drive ended; pose, distance (m) and angle (rad) as the last cycle saw them.

    `cause` is what had failed last where patience was over, None where the controller had not returned.
    """

    outcome: ControlOutcome
    message: str
    pose: Optional[FramedPose] = None
    distance: float = math.inf
    angle: float = math.inf
    cause: Optional[ControlOutcome] = None


@dataclass(frozen=True)
class RecoverGoal:
    """Run a recovery behaviour; the first one where `behavior` is empty."""

    behavior: str = ""
    slot: int = 0


@dataclass(frozen=True)
class RecoverResult:
    """How a recovery behaviour ended."""

    outcome: RecoveryOutcome
    message: str
    used_plugin: str = ""


class NavigateOutcome(Enum):
    """What move_base itself ends with; what its parts end with, it passes on as theirs."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    CANCELED = "CANCELED"
    COLLISION = "COLLISION"
    OSCILLATION = "OSCILLATION"
    START_BLOCKED = "START_BLOCKED"
    GOAL_BLOCKED = "GOAL_BLOCKED"
    TF_ERROR = "TF_ERROR"
    INTERNAL_ERROR = "INTERNAL_ERROR"
    STOPPED = "STOPPED"


@dataclass(frozen=True)
class NavigateGoal:
    """Go somewhere, with planning, driving and recovering.

    Attributes:
        target: Where to.
        planner, controller: Names; the first ones where empty.
        recovery_behaviors: Names in the order to try; all loaded ones where empty.
        tolerance: Distance (m) by which a target that cannot be reached, or is no room for the robot, may be missed.
    """

    target: FramedPose
    planner: str = ""
    controller: str = ""
    recovery_behaviors: Tuple[str, ...] = ()
    tolerance: float = 0.0


@dataclass(frozen=True)
class NavigateResult:
    """How it ended; `outcome` is a NavigateOutcome, or the outcome of the part that failed."""

    outcome: Enum
    message: str
    pose: Optional[FramedPose] = None
    distance: float = math.inf
    angle: float = math.inf
