"""The four action servers: callbacks queue goals and cancels, the stepping thread carries them out and answers."""

from __future__ import annotations

import collections
import threading
from enum import Enum
from typing import Any, Callable, Deque, Dict, List, Optional, Type

import rospy
from mbf_msgs.msg import ExePathAction, GetPathAction, MoveBaseAction, RecoveryAction

from mbf_relay.navigation.controller_execution import PAUSED
from mbf_relay.navigation.goals import FollowFeedback, NavigateOutcome
from mbf_relay.navigation.move_base_states import NavigationState
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.worker import InlineWorker, Job, Worker
from mbf_relay.outcomes import ControlOutcome, NavigationError, PlanOutcome, RecoveryOutcome
from mbf_relay.ros.common.actions.action_server import ActionServer
from mbf_relay.ros.common.actions.goal_tracker import TrackedGoal
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.ros.server import messages

BEGUN_PER_STEP = 5
"""Largest number of goals begun in one step of navigation, so that hundreds of goals at once do not delay a driving
robot's next velocity."""

WITHOUT_TROUBLE = {"", PAUSED, *(state.value for state in NavigationState)}
"""Messages of feedback that are no warnings."""


class Request:
    """A goal from its arrival on: its handle, the conversion of its message, and later its task.

    Args:
        handle: The goal's handle.
        reading: Job that converts the message; None for a goal that was cancelled before it came.

    Attributes:
        slot: Its concurrency slot; 0 where the message has none.
        cancelled: Whether a cancel has come.
        task: The navigator's task, None before the goal has begun.
    """

    def __init__(self, handle: TrackedGoal, reading: Optional[Job]) -> None:
        self.handle, self.reading = handle, reading
        self.goal_id: str = handle.get_goal_id().id
        self.slot: int = getattr(handle.get_goal(), "concurrency_slot", 0)
        self.cancelled = reading is None
        self.task: Optional[Task[Any]] = None


class Action:
    """One action server and the conversion of its messages.

    Args:
        name: Name of the action in the node's private namespace.
        action_type: Generated message class.
        outcomes: Enumeration of its outcomes.
        read: Converts a goal message; raises NavigationError where it is invalid. Called on the worker, since long
            paths take time.
        begin: Hands the goal to the navigator and returns its task.
        result: Converts a task's result, given a stamp.
        feedback: Converts feedback, given stamp and robot frame; None where the action has none.
        robot_frame: The robot's frame, for feedback.
        worker: Runs `read`.
        wake: Wakes the stepping thread, which calls `take_up`; called from any thread.
        make_server: Makes the action server; constructor as ActionServer's.
        ros_now: Gives ROS time, as a message has it.

    Attributes:
        server: The action server.
    """

    def __init__(
        self, name: str, action_type: Any, outcomes: Type[Enum], read: Callable[[Any], Any],
        begin: Callable[[Any], Task[Any]], result: Callable[[Any, Any], Any],
        feedback: Optional[Callable[[Any, Any, str], Any]] = None, *, robot_frame: str, worker: Worker,
        wake: Callable[[], None], make_server: Callable[..., Any], ros_now: Callable[[], Any],
    ) -> None:
        self.name, self._read, self._begin_goal, self._result, self._feedback = name, read, begin, result, feedback
        self._result_type, self._outcomes = type(action_type().action_result.result), outcomes
        self._robot_frame, self._worker, self._wake, self._ros_now = robot_frame, worker, wake, ros_now
        # guards the two below; taken while the action server's lock is held, so that one must not be taken inside this
        self._lock = threading.Lock()
        self._inbox: Deque[Request] = collections.deque()
        self._requests: Dict[str, Request] = {}
        self._running: List[Request] = []
        self._warnings = ThrottledWarnings()
        self.server = make_server(
            f"~{name}", action_type, self._on_goal, self._on_cancel, self._recalled, overtaken_cb=self._on_overtaken)

    # callbacks, in rospy's threads: they queue requests and wake the stepping thread

    def _on_goal(self, handle: TrackedGoal) -> None:
        goal = handle.get_goal()
        request = Request(handle, self._worker.start(lambda: self._read(goal)))
        with self._lock:
            self._requests[request.goal_id] = request
            self._inbox.append(request)
        self._wake()

    def _on_cancel(self, handle: TrackedGoal) -> None:
        goal_id = handle.get_goal_id().id
        with self._lock:
            request = self._requests.get(goal_id)
            if request is None:
                return
            request.cancelled = True
            if request.task is not None:
                request.task.cancel()
        self._wake()

    def _on_overtaken(self, handle: TrackedGoal) -> None:
        with self._lock:
            self._inbox.append(Request(handle, None))  # not in _requests: the action server has ended it
        self._wake()

    # the stepping thread

    def take_up(self) -> bool:
        """Begin goals in the order they came, up to BEGUN_PER_STEP; return whether more are ready."""
        taken: List[Request] = []
        with self._lock:
            while self._is_ready() and len(taken) < BEGUN_PER_STEP:
                taken.append(self._inbox.popleft())
            more = self._is_ready()
        for request in taken:
            self._begin(request)
        return more

    def _is_ready(self) -> bool:
        if not self._inbox:
            return False
        first = self._inbox[0]
        return first.reading is None or first.cancelled or first.reading.done

    def report(self) -> None:
        """Send feedback of running goals, and results of those that have ended."""
        stamp = self._ros_now()
        still_running: List[Request] = []
        with self._lock:
            running = [request for request in self._running if self._requests.get(request.goal_id) is request]
        for request in running:
            task = request.task
            assert task is not None
            for feedback in task.take_feedback():
                if self._feedback is not None:
                    request.handle.publish_feedback(self._feedback(feedback, stamp, self._robot_frame))
                    self._warn_of(feedback)
            if task.ending is not None:
                self._end(request, task.ending, self._result(task.result, stamp))
            else:
                still_running.append(request)
        self._running = still_running
        if running and not still_running:
            self._warnings.worked()  # the next goal's trouble is another one

    def _warn_of(self, feedback: FollowFeedback) -> None:
        """Log what keeps the robot from its goal, which clients of move_base are not told."""
        if feedback.message in WITHOUT_TROUBLE:
            self._warnings.worked()
        else:
            outcome = "" if feedback.outcome is ControlOutcome.SUCCESS else f"{feedback.outcome.name}: "
            self._warnings.say(f"{self.name}: {outcome}{feedback.message}")

    def abort_all(self, outcome: str, message: str) -> None:
        """Abort all goals, as after an internal error or at shutdown; `outcome` is a name in the enumeration."""
        with self._lock:
            self._inbox.clear()
        self.abort_running(outcome, message)

    def abort_running(self, outcome: str, message: str) -> None:
        """Abort all goals that have begun, from any thread, while the stepping thread hangs; queued goals stay.
        """
        with self._lock:
            begun = [request for request in self._requests.values() if request.cancelled or request not in self._inbox]
        for request in begun:
            task = request.task
            if task is not None and task.ending is not None:  # just now; a rejected goal cannot be aborted
                self._end(request, task.ending, self._result(task.result, self._ros_now()))
            else:
                if task is None:
                    request.handle.set_accepted()
                self._end(request, Ending.ABORTED, self._failure(self._outcomes[outcome], message))

    def _begin(self, request: Request) -> None:
        if request.reading is None or request.cancelled:
            self._call_off(request.slot)
            self._end(request, Ending.CANCELED, self._recalled())
            return
        try:
            goal = request.reading.result()
        except NavigationError as error:
            request.handle.set_accepted()
            self._end(request, Ending.ABORTED, self._failure(error.outcome, error.message))
            return
        except Exception as error:  # an unforeseen message must end its own goal only
            request.handle.set_accepted()
            text = f"the goal could not be read: {type(error).__name__}: {error}"
            self._end(request, Ending.ABORTED, self._failure(self._outcomes["INTERNAL_ERROR"], text))
            return
        task = self._begin_goal(goal)
        if task.ending is not Ending.REJECTED:
            request.handle.set_accepted()
        with self._lock:
            request.task = task
            if request.cancelled:
                task.cancel()
        self._running.append(request)

    def _call_off(self, slot: int) -> None:
        """Cancel what runs in a slot, because a newer goal for it was cancelled before it began.

        The client has replaced its old goal by the new one and will not cancel the old one.
        """
        for running in self._running:
            if running.slot == slot and running.task is not None:
                running.task.cancel()

    def _recalled(self) -> Any:
        return self._failure(self._outcomes["CANCELED"], "Goal cancelled before it began")

    def _failure(self, outcome: Enum, message: str) -> Any:
        return self._result_type(outcome=messages.outcome_code(outcome, self._result_type), message=message)

    def _end(self, request: Request, ending: Ending, result: Any) -> None:
        handle = request.handle
        with self._lock:
            if self._requests.pop(request.goal_id, None) is None:
                return  # abort_running has ended it while the stepping thread hung
        if ending is Ending.CANCELED and handle.lapse:
            result.message = handle.lapse
        finish = {
            Ending.SUCCEEDED: handle.set_succeeded, Ending.ABORTED: handle.set_aborted,
            Ending.CANCELED: handle.set_canceled, Ending.REJECTED: handle.set_rejected,
        }[ending]
        finish(result, result.message)
        log = rospy.loginfo if ending in (Ending.SUCCEEDED, Ending.CANCELED) else rospy.logwarn
        log("%s %s: %s", self.name, ending.name.lower(), result.message)


def make_actions(
    navigator: Navigator, make_server: Callable[..., Any] = ActionServer,
    ros_now: Callable[[], Any] = rospy.get_rostime, worker: Optional[Worker] = None,
    wake: Callable[[], None] = lambda: None,
) -> List[Action]:
    """Make the four action servers of a navigator; they are not started yet.

    Args:
        navigator: Carries out the goals.
        make_server: Makes an action server; constructor as ActionServer's.
        ros_now: Returns ROS time as rospy.Time.
        worker: Runs conversions of goals; None to run them inline.
        wake: Wakes the stepping thread; called from any thread.
    """
    shared: Dict[str, Any] = {
        "robot_frame": navigator.parameters.robot_frame, "worker": worker or InlineWorker(), "wake": wake,
        "make_server": make_server, "ros_now": ros_now,
    }
    return [
        Action(
            "get_path", GetPathAction, PlanOutcome, messages.plan_goal, navigator.get_path, messages.plan_result,
            **shared),
        Action(
            "exe_path", ExePathAction, ControlOutcome, messages.follow_goal, navigator.exe_path, messages.follow_result,
            messages.follow_feedback, **shared),
        Action(
            "recovery", RecoveryAction, RecoveryOutcome, messages.recover_goal, navigator.recovery,
            messages.recover_result, **shared),
        Action(
            "move_base", MoveBaseAction, NavigateOutcome, messages.navigate_goal, navigator.move_base,
            messages.navigate_result, messages.navigate_feedback, **shared),
    ]
