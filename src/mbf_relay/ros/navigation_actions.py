"""The four actions on goal handles: requests in from any thread, everything else on the stepping thread."""

from __future__ import annotations

import collections
import threading
from typing import Any, Callable, Deque, Dict, List, Optional

import actionlib
import rospy
from mbf_msgs.msg import (
    ExePathAction, ExePathResult, GetPathAction, GetPathResult, MoveBaseAction, MoveBaseResult, RecoveryAction,
    RecoveryResult,
)

from mbf_relay.navigation.navigator import Navigator
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.outcomes import ControlOutcome, NavigationError, PlanOutcome, RecoveryOutcome
from mbf_relay.ros import navigation_messages as messages
from mbf_relay.ros.outcome_codes import code_of


class Request:
    """A goal handle, and once it was taken up, its task."""

    def __init__(self, handle: Any) -> None:
        self.handle = handle
        self.cancelled = False
        self.task: "Optional[Task[Any]]" = None


class Action:
    """One action server: what it takes, whom it asks, what it answers.

    Args:
        name: Name below the node's.
        action_type: Generated message class.
        begin: Converts a goal message and hands it to the navigator; raises NavigationError for nonsense.
        result: Converts a task's result, given a stamp.
        canceled: Result for a goal cancelled before it began.
        failed: Makes a result from an outcome's text, for goals that make no sense.
        feedback: Converts feedback, given stamp and robot frame; None where the action has none.
    """

    def __init__(
        self, name: str, action_type: Any, begin: Callable[[Any], "Task[Any]"], result: Callable[[Any, Any], Any],
        canceled: Callable[[], Any], failed: Callable[[NavigationError], Any],
        feedback: Optional[Callable[[Any, Any, str], Any]] = None,
    ) -> None:
        self.name, self.begin, self.result, self.feedback = name, begin, result, feedback
        self.canceled, self.failed = canceled, failed
        self.wake: Callable[[], None] = lambda: None
        self.robot_frame = ""
        self._lock = threading.Lock()  # guards the two below; nothing else is taken while it is held
        self._inbox: Deque[Request] = collections.deque()
        self._requests: Dict[str, Request] = {}
        self._running: List[Request] = []
        self._server = actionlib.ActionServer(
            f"~{name}", action_type, self._on_goal, self._on_cancel, auto_start=False
        )

    def start(self) -> None:
        """Advertise."""
        self._server.start()

    # callbacks: they note what was asked and wake the stepper

    def _on_goal(self, handle: Any) -> None:
        request = Request(handle)
        with self._lock:
            self._requests[handle.get_goal_id().id] = request
            self._inbox.append(request)
        self.wake()

    def _on_cancel(self, handle: Any) -> None:
        with self._lock:
            request = self._requests.get(handle.get_goal_id().id)
            if request is None:
                return
            request.cancelled = True
            if request.task is not None:
                request.task.cancel()
        self.wake()

    # the stepping thread

    def take_up(self) -> None:
        """Begin what was asked for since the last call, in the order it came."""
        with self._lock:
            taken = list(self._inbox)
            self._inbox.clear()
        for request in taken:
            self._begin(request)

    def report(self) -> None:
        """Send what running goals have to say, and how they ended."""
        stamp = rospy.get_rostime()
        still_running: List[Request] = []
        for request in self._running:
            for feedback in request.task.take_feedback():
                if self.feedback is not None:
                    request.handle.publish_feedback(self.feedback(feedback, stamp, self.robot_frame))
            if request.task.done:
                self._end(request, request.task.ending, self.result(request.task.result, stamp))
            else:
                still_running.append(request)
        self._running = still_running

    def abort_all(self, make_result: Callable[[], Any]) -> None:
        """End every goal that is left, for when stepping itself failed or the node goes down."""
        with self._lock:
            waiting = list(self._inbox)
            self._inbox.clear()
        for request in waiting:
            request.handle.set_accepted()
        for request in self._running + waiting:
            self._end(request, Ending.ABORTED, make_result())
        self._running = []

    def _begin(self, request: Request) -> None:
        if request.cancelled:
            self._end(request, Ending.CANCELED, self.canceled())
            return
        try:
            task = self.begin(request.handle.get_goal())
        except NavigationError as error:
            request.handle.set_accepted()
            self._end(request, Ending.ABORTED, self.failed(error))
            return
        if task.ending is not Ending.REJECTED:
            request.handle.set_accepted()
        with self._lock:
            request.task = task
            if request.cancelled:
                task.cancel()
        self._running.append(request)

    def _end(self, request: Request, ending: Ending, result: Any) -> None:
        handle = request.handle
        with self._lock:
            self._requests.pop(handle.get_goal_id().id, None)
        finish = {
            Ending.SUCCEEDED: handle.set_succeeded, Ending.ABORTED: handle.set_aborted,
            Ending.CANCELED: handle.set_canceled, Ending.REJECTED: handle.set_rejected,
        }[ending]
        finish(result, result.message)
        log = rospy.loginfo if ending in (Ending.SUCCEEDED, Ending.CANCELED) else rospy.logwarn
        log("%s %s: %s", self.name, ending.name.lower(), result.message)


def make_actions(navigator: Navigator) -> List[Action]:
    """Make the four action servers over a navigator, not yet advertised."""
    text = "Goal cancelled before it began"

    def result_of(result_type: Any) -> Callable[[NavigationError], Any]:
        return lambda error: result_type(
            outcome=messages.outcome_code(error.outcome, result_type), message=error.message
        )

    return [
        Action(
            "get_path", GetPathAction, lambda goal: navigator.get_path(messages.plan_goal(goal)), messages.plan_result,
            lambda: GetPathResult(outcome=code_of(PlanOutcome.CANCELED, GetPathResult), message=text),
            result_of(GetPathResult),
        ),
        Action(
            "exe_path", ExePathAction, lambda goal: navigator.exe_path(messages.follow_goal(goal)),
            messages.follow_result,
            lambda: ExePathResult(outcome=code_of(ControlOutcome.CANCELED, ExePathResult), message=text),
            result_of(ExePathResult), messages.follow_feedback,
        ),
        Action(
            "recovery", RecoveryAction, lambda goal: navigator.recovery(messages.recover_goal(goal)),
            messages.recover_result,
            lambda: RecoveryResult(outcome=code_of(RecoveryOutcome.CANCELED, RecoveryResult), message=text),
            result_of(RecoveryResult),
        ),
        Action(
            "move_base", MoveBaseAction, lambda goal: navigator.move_base(messages.navigate_goal(goal)),
            messages.navigate_result,
            lambda: MoveBaseResult(outcome=MoveBaseResult.CANCELED, message=text),
            result_of(MoveBaseResult), messages.navigate_feedback,
        ),
    ]
