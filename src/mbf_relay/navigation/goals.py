"""Goals, feedback and results of the four actions get_path, exe_path, recovery and move_base, without ROS types."""

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
    """Goal of get_path: find a path.

    Attributes:
        target: Goal pose.
        start: Start pose; None for the robot's pose.
        tolerance: Largest distance (m) from the path's end to the target.
        planner: Name of the planner; empty for the first.
        slot: Concurrency slot; a new goal in a slot replaces the running one.
        tolls: Places to avoid where the detour is short enough, in the global frame.
    """

    target: FramedPose
    start: Optional[FramedPose] = None
    tolerance: float = 0.0
    planner: str = ""
    slot: int = 0
    tolls: Tuple[Toll, ...] = ()


@dataclass(frozen=True)
class PlanResult:
    """Result of get_path.

    Attributes:
        outcome: SUCCESS, or why there is no path.
        message: Explanation for the user.
        path: The path in the global frame, None unless `outcome` is SUCCESS.
        cost: The planner's cost, or the length (m) where the planner gives none.
        cause: With PAT_EXCEEDED, the outcome of the last failed try; None if the planner has not returned.
    """

    outcome: PlanOutcome
    message: str
    path: Optional[Path] = None
    cost: float = 0.0
    cause: Optional[PlanOutcome] = None


@dataclass(frozen=True)
class FollowGoal:
    """Goal of exe_path: drive along a path.

    Attributes:
        path: The path.
        controller: Name of the controller; empty for the first.
        slot: Concurrency slot; a new goal in a slot replaces the running one.
        tolerance: Goal tolerance; None, or 0 for one of its parts, for the controller's own.
        same_goal: Whether the path leads to the same goal as the one it replaces; None to compare their ends.
    """

    path: Path
    controller: str = ""
    slot: int = 0
    tolerance: Optional[GoalTolerance] = None
    same_goal: Optional[bool] = None


@dataclass(frozen=True)
class FollowFeedback:
    """Feedback on one control cycle.

    Attributes:
        outcome: SUCCESS with a velocity, otherwise why there was none.
        message: Explanation for the user, empty if all is well.
        pose: The robot's pose in the global frame, None before the first.
        velocity: The last command (body frame; m/s, rad/s).
        distance, angle: To the path's last pose (m, rad); infinite where not known.
        late: Delay (s) of the robot's reaction to commands, 0.0 where it is small or not known.
        refused: Whether the controller was called and found no velocity.
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
        """Whether the controller was not called, as without a pose; the robot is then stopped."""
        return self.outcome is not ControlOutcome.SUCCESS and not self.refused


@dataclass(frozen=True)
class FollowResult:
    """Result of exe_path.

    Attributes:
        outcome: SUCCESS, or why the drive ended.
        message: Explanation for the user.
        pose, distance, angle: As in FollowFeedback, at the last cycle.
        cause: With PAT_EXCEEDED, the outcome of the last failed cycle; None if the controller has not returned.
    """

    outcome: ControlOutcome
    message: str
    pose: Optional[FramedPose] = None
    distance: float = math.inf
    angle: float = math.inf
    cause: Optional[ControlOutcome] = None


@dataclass(frozen=True)
class RecoverGoal:
    """Goal of recovery: run the behaviour of that name; empty for the first."""

    behavior: str = ""
    slot: int = 0


@dataclass(frozen=True)
class RecoverResult:
    """Result of recovery, with the name of the behaviour that ran."""

    outcome: RecoveryOutcome
    message: str
    used_plugin: str = ""


class NavigateOutcome(Enum):
    """Outcomes of move_base itself; a failed plan or drive keeps its PlanOutcome or ControlOutcome."""

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
    """Goal of move_base: plan, drive, and recover where that fails.

    Attributes:
        target: Goal pose.
        planner, controller: Names of plugins; empty for the first of each list.
        recovery_behaviors: Names in the order to try; empty for all that are loaded.
        tolerance: Largest distance (m) from the path's end to a target that is blocked or cannot be reached.
    """

    target: FramedPose
    planner: str = ""
    controller: str = ""
    recovery_behaviors: Tuple[str, ...] = ()
    tolerance: float = 0.0


@dataclass(frozen=True)
class NavigateResult:
    """Result of move_base.

    Attributes:
        outcome: A NavigateOutcome, or the PlanOutcome or ControlOutcome of what failed.
        message: Explanation for the user.
        pose: The robot's last known pose, None where there is none.
        distance, angle: From there to the target (m, rad).
    """

    outcome: Enum
    message: str
    pose: Optional[FramedPose] = None
    distance: float = math.inf
    angle: float = math.inf
