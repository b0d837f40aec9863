"""What a move_base goal can be at: one state at a time, each with what it alone has."""

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
    """What a move_base goal is at."""

    PLANNING = "looking for a path"
    DRIVING = "driving along a path"
    RECOVERING = "running a recovery behaviour"
    DONE = "ended"


@dataclass
class Planning:
    """Looking for a path; the drive of the goal this one replaced goes on until there is one."""

    plan: PlannerExecution
    drive: Optional[Task[FollowResult]] = None
    state = NavigationState.PLANNING


@dataclass
class Driving:
    """Driving along a path, and now and then looking for a better one."""

    drive: Task[FollowResult]
    path: Path
    replan: Optional[PlannerExecution] = None
    state = NavigationState.DRIVING


@dataclass
class Recovering:
    """Running a recovery behaviour, after which is planned again."""

    recovery: RecoveryExecution
    state = NavigationState.RECOVERING


@dataclass
class Done:
    """Ended; nothing of it goes on."""

    state = NavigationState.DONE
