"""The state of a goal: it may be cancelled, and ends exactly once."""

from __future__ import annotations

from enum import Enum
from typing import Any, Generic, List, Optional, TypeVar

R = TypeVar("R")


class Ending(Enum):
    """How a goal ended, by actionlib's names."""

    SUCCEEDED = "SUCCEEDED"
    ABORTED = "ABORTED"
    CANCELED = "CANCELED"
    REJECTED = "REJECTED"


class Task(Generic[R]):
    """Handle of a goal: cancel, feedback, ending and result.

    `cancel` may be called from any thread at any time, all else only from the thread that steps navigation. That thread
    checks for a cancel at each step, and once more right before it sends a velocity.

    Args:
        owner: The goal it is a part of, if any; cancelling that cancels this one.
    """

    def __init__(self, owner: Optional[Task[Any]] = None) -> None:
        self._owner = owner
        self._cancel_requested = False
        self._result: Optional[R] = None
        self._ending: Optional[Ending] = None
        self._feedback: List[Any] = []

    def cancel(self) -> None:
        """Request a cancel; the goal ends at the next update."""
        self._cancel_requested = True

    @property
    def cancel_requested(self) -> bool:
        """Return whether this goal, or the one it is a part of, was cancelled."""
        return self._cancel_requested or (self._owner is not None and self._owner.cancel_requested)

    @property
    def done(self) -> bool:
        """Return whether the goal ended."""
        return self._ending is not None

    @property
    def ending(self) -> Optional[Ending]:
        """How it ended, None before."""
        return self._ending

    @property
    def result(self) -> Optional[R]:
        """Its result, None before it ended."""
        return self._result

    def ended_with(self) -> R:
        """Return its result; RuntimeError before it ended."""
        if self._result is None:
            raise RuntimeError("the goal still runs; ask `done` first")
        return self._result

    def end(self, ending: Ending, result: R) -> None:
        """End the goal; RuntimeError where it has ended already."""
        if self._ending is not None:
            raise RuntimeError(f"a goal that ended {self._ending.name} cannot end {ending.name}")
        self._result, self._ending = result, ending

    def add_feedback(self, feedback: Any) -> None:
        """Add feedback, of which the newest 100 are kept; dropped once the goal has ended."""
        if self._ending is None:
            self._feedback = self._feedback[-99:] + [feedback]

    def take_feedback(self) -> List[Any]:
        """Return the feedback since the last call, oldest first."""
        taken, self._feedback = self._feedback, []
        return taken
