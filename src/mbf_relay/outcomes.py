"""Outcomes of navigation, by Move Base Flex's names, and the exceptions that carry them.

The numbers belong to the message definitions of the system at hand, which differ between versions; they are looked
up by name at the ROS edge and nowhere else.
"""

from __future__ import annotations

from enum import Enum
from typing import ClassVar, Type


class PlanOutcome(Enum):
    """Outcomes of get_path."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    CANCELED = "CANCELED"
    INVALID_START = "INVALID_START"
    INVALID_GOAL = "INVALID_GOAL"
    BLOCKED_START = "BLOCKED_START"
    BLOCKED_GOAL = "BLOCKED_GOAL"
    NO_PATH_FOUND = "NO_PATH_FOUND"
    PAT_EXCEEDED = "PAT_EXCEEDED"
    EMPTY_PATH = "EMPTY_PATH"
    TF_ERROR = "TF_ERROR"
    NOT_INITIALIZED = "NOT_INITIALIZED"
    INVALID_PLUGIN = "INVALID_PLUGIN"
    INTERNAL_ERROR = "INTERNAL_ERROR"
    OUT_OF_MAP = "OUT_OF_MAP"
    MAP_ERROR = "MAP_ERROR"
    STOPPED = "STOPPED"


class ControlOutcome(Enum):
    """Outcomes of exe_path."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    CANCELED = "CANCELED"
    NO_VALID_CMD = "NO_VALID_CMD"
    PAT_EXCEEDED = "PAT_EXCEEDED"
    COLLISION = "COLLISION"
    OSCILLATION = "OSCILLATION"
    ROBOT_STUCK = "ROBOT_STUCK"
    MISSED_GOAL = "MISSED_GOAL"
    MISSED_PATH = "MISSED_PATH"
    BLOCKED_GOAL = "BLOCKED_GOAL"
    BLOCKED_PATH = "BLOCKED_PATH"
    INVALID_PATH = "INVALID_PATH"
    TF_ERROR = "TF_ERROR"
    NOT_INITIALIZED = "NOT_INITIALIZED"
    INVALID_PLUGIN = "INVALID_PLUGIN"
    INTERNAL_ERROR = "INTERNAL_ERROR"
    OUT_OF_MAP = "OUT_OF_MAP"
    MAP_ERROR = "MAP_ERROR"
    STOPPED = "STOPPED"


class RecoveryOutcome(Enum):
    """Outcomes of recovery."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    CANCELED = "CANCELED"
    PAT_EXCEEDED = "PAT_EXCEEDED"
    TF_ERROR = "TF_ERROR"
    NOT_INITIALIZED = "NOT_INITIALIZED"
    INVALID_PLUGIN = "INVALID_PLUGIN"
    INTERNAL_ERROR = "INTERNAL_ERROR"
    STOPPED = "STOPPED"
    IMPASSABLE = "IMPASSABLE"


def as_told(text: object) -> str:
    """Return a text that can be encoded as UTF-8: lone surrogates, as in names of files, become escapes."""
    return str(text).encode("utf-8", "backslashreplace").decode("utf-8")


class NavigationError(Exception):
    """Navigation cannot go on; the subclass says which action failed, `outcome` how, the text why.

    Attributes:
        outcomes: What `outcome` is one of.
        outcome: The member of the action's outcomes to report.

    Raises:
        TypeError: The outcome is none of the action's.
    """

    outcomes: ClassVar[Type[Enum]] = Enum

    def __init__(self, outcome: Enum, message: str) -> None:
        if not isinstance(outcome, self.outcomes):
            raise TypeError(f"{outcome!r} is no outcome of a {type(self).__name__}; choose a {self.outcomes.__name__}")
        super().__init__(as_told(message))
        self.outcome = outcome

    @property
    def message(self) -> str:
        """What was wrong, with the value, and what to do about it."""
        return str(self.args[0])


class PlanningError(NavigationError):
    """No path."""

    outcomes = PlanOutcome
    outcome: PlanOutcome


class ControlError(NavigationError):
    """No velocity."""

    outcomes = ControlOutcome
    outcome: ControlOutcome


class RecoveryError(NavigationError):
    """A recovery behaviour gave up."""

    outcomes = RecoveryOutcome
    outcome: RecoveryOutcome


class TransformError(Exception):
    """Two frames could not be related at the time asked for; the text names them and the age of the newest relation."""


class StaleDataError(Exception):
    """Something the robot must not drive without is too old; the text names it and its age in seconds."""
