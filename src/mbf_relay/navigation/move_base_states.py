"""States of a move_base goal, each with the executions and tasks that exist only in it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Optional

from mbf_relay.navigation.goals import FollowResult
from mbf_relay.navigation.planner_execution import PlannerExecution
from mbf_relay.navigation.recovery_execution import RecoveryExecution
from mbf_relay.navigation.task import Task
from mbf_relay.planning.path import Path


class NavigationState(Enum):
    """State of a move_base goal; the value is the text in its feedback."""

    PLANNING = "looking for a path"
    DRIVING = "driving along a path"
    RECOVERING = "running a recovery behaviour"
    DONE = "ended"


@dataclass
class Planning:
    """Planning; `drive` is that of the replaced goal, which goes on until there is a path, or None."""

    plan: PlannerExecution
    drive: Optional[Task[FollowResult]] = None
    state = NavigationState.PLANNING


@dataclass
class Driving:
    """Driving along a path; `replan` is the running replan, or None."""

    drive: Task[FollowResult]
    path: Path
    replan: Optional[PlannerExecution] = None
    state = NavigationState.DRIVING


@dataclass
class Recovering:
    """Running a recovery behaviour; planning follows."""

    recovery: RecoveryExecution
    state = NavigationState.RECOVERING


@dataclass
class Done:
    """Ended."""

    state = NavigationState.DONE
