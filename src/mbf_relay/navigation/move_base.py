"""The move_base state machine: plan, drive, recover and plan again, until the goal is reached or all was tried."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum
from typing import Any, Callable, List, Mapping, Optional, Protocol, Tuple, Union

from mbf_relay.control.controller import Controller
from mbf_relay.geometry import STOP, Pose2D, angle_between
from mbf_relay.navigation.goals import (
    FollowFeedback,
    FollowGoal,
    FollowResult,
    FramedPose,
    NavigateGoal,
    NavigateOutcome,
    NavigateResult,
    PlanGoal,
    PlanResult,
    RecoverGoal,
)
from mbf_relay.navigation.move_base_states import Done, Driving, NavigationState, Planning, Recovering
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.planner_execution import PlannerExecution
from mbf_relay.navigation.progress import GoalProgress
from mbf_relay.navigation.recovery_execution import RecoveryExecution
from mbf_relay.navigation.recovery_policy import Recoverable, TriedBehaviors, can_change, recoverable
from mbf_relay.navigation.refused_places import Toll
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.robot import Robot
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.ways import Ways
from mbf_relay.outcomes import ControlOutcome, PlanOutcome, RecoveryOutcome, TransformError
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Planner
from mbf_relay.recovery.recovery import Recovery
from mbf_relay.timing import Pacer, Stopwatch

NO_REPLAN_WITHIN = 0.1
"""Distance (m) to the goal below which it does not replan."""


RecoveryWatcher = Callable[[str, int, int, Optional[FramedPose], str], None]
"""Called as a recovery begins: with its behaviour, index in the list, length of the list, robot's pose and reason."""


class NavigationParts(Protocol):
    """What move_base uses of the Navigator.

    Attributes:
        parameters: The server's.
        robot: Gives poses and takes velocities.
        costmaps: "global" and "local".
        planners, controllers, recoveries: The plugins; the first planner and controller are the defaults.
        recovery_watcher, failure_watcher: Called when a recovery begins, and with the text of one that failed.
    """

    parameters: NavigatorParameters
    robot: Robot
    costmaps: Mapping[str, Any]
    planners: Registry[Planner]
    controllers: Registry[Controller]
    recoveries: Registry[Recovery]
    recovery_watcher: Optional[RecoveryWatcher]
    failure_watcher: Optional[Callable[[str], None]]

    def new_plan(
        self, goal: PlanGoal, retry: bool = True, *, pathless: Optional[Stopwatch] = None
    ) -> PlannerExecution:
        """Return an execution of `goal` outside of the concurrency slots."""

    def new_recovery(self, goal: RecoverGoal, controller: str = "") -> RecoveryExecution:
        """Return an execution of `goal` outside of the concurrency slots."""

    def exe_path(self, goal: FollowGoal, owner: Optional[Task[Any]] = None) -> Task[FollowResult]:
        """Drive along a path as part of the task `owner`."""

    def update_drive(self, now: float) -> None:
        """Advance the drive of slot 0 alone."""


class MoveBase:
    """One move_base goal; advanced by `update` until its task is done.

    Behaviour as mbf_abstract_nav's MoveBaseAction: it plans, drives in slot 0 of exe_path, replans at planner_frequency
    while driving, and after a failure runs the next recovery behaviour and plans again. It differs in two points: a
    failure that no behaviour can change ends the goal at once (see `recovery_policy`), and the list of behaviours
    starts over when the robot is at another place, not with each path that is found (see `TriedBehaviors`). While the
    first plan of a new goal is made, the robot goes on along the path of the goal it replaced.

    Args:
        goal: Where to go.
        navigator: Gives planners, the drive of slot 0 and recoveries.
        task: Ends with the result.
        driving: The drive of the replaced move_base goal, if it still goes on.
    """

    def __init__(
        self, goal: NavigateGoal, navigator: NavigationParts, task: Task[NavigateResult],
        driving: Optional[Task[FollowResult]] = None,
    ) -> None:
        self.goal, self.task = goal, task
        self._navigator = navigator
        self._behaviors: Tuple[str, ...] = goal.recovery_behaviors or tuple(navigator.recoveries.names)
        self._tried, self._ways = TriedBehaviors(self._behaviors), Ways(navigator.robot, navigator.costmaps["global"])
        self._progress, self._pathless = GoalProgress(), Stopwatch()
        self._replan_pacer, self._feedback_pacer = Pacer(), Pacer()
        self._replan_trouble = self._recovery_fault = ""
        self._last = FollowFeedback(ControlOutcome.SUCCESS, "")
        self._at: Union[Planning, Driving, Recovering, Done] = Planning(self._new_plan(), driving)

    @property
    def state(self) -> NavigationState:
        """The present state."""
        return self._at.state

    @property
    def driving(self) -> Optional[Task[FollowResult]]:
        """The running drive, None where there is none."""
        drive = self._at.drive if isinstance(self._at, (Planning, Driving)) else None
        return drive if drive is not None and not drive.done else None

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a job."""
        at = self._at
        if isinstance(at, Planning):
            return min(at.plan.due, self._feedback_pacer.next)
        if isinstance(at, Recovering):
            return min(at.recovery.due, self._feedback_pacer.next)
        if isinstance(at, Driving):
            if at.drive.done:  # it ended after the last update of this
                return -math.inf
            if at.replan is not None:
                return at.replan.due
            return self._replan_pacer.next if self._navigator.parameters.planner_frequency > 0.0 else math.inf
        return math.inf

    def replaced(self) -> None:
        """End because a new goal takes over; the drive goes on until the new goal has a path."""
        at = self._at
        if isinstance(at, Recovering) and not at.recovery.task.done:
            at.recovery.replaced()
        searching = at.plan if isinstance(at, Planning) else at.replan if isinstance(at, Driving) else None
        if searching is not None and not searching.task.done:
            searching.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "Goal preempted by a new goal")
        self._end(Ending.CANCELED, NavigateOutcome.CANCELED, "Goal preempted by a new goal")

    def update(self, now: float) -> None:
        """Advance the present state."""
        self._progress.await_start(now, self._navigator.robot.paused)
        at = self._at
        if isinstance(at, Done):
            return
        if self.task.cancel_requested:
            self._cancel(now, at)
            return
        if not isinstance(at, Driving) and self._feedback_pacer.is_due(now):
            self._feedback_pacer.passed(now, 1.0 / self._navigator.parameters.controller_frequency)
            self._tell_where(at)
        if isinstance(at, Planning):
            self._update_plan(now, at)
        elif isinstance(at, Driving):
            self._update_drive(now, at)
        else:
            self._update_recovery(now, at)

    def _tell_where(self, at: Union[Planning, Recovering]) -> None:
        """Give feedback with the robot's pose at the control rate, since move_base gives feedback in every state.

        The drive of a replaced goal, which may still go on, reports the distance to that goal.
        """
        pose, distance, angle = self._where()
        if pose is not None:
            velocity = self._navigator.robot.commanded or STOP
            self.task.add_feedback(
                FollowFeedback(ControlOutcome.SUCCESS, at.state.value, pose, velocity, distance, angle))

    # planning

    def _new_plan(self, tolls: Tuple[Toll, ...] = (), retry: bool = True) -> PlannerExecution:
        goal = PlanGoal(self.goal.target, tolerance=self.goal.tolerance, planner=self.goal.planner, tolls=tolls)
        return self._navigator.new_plan(goal, retry, pathless=self._pathless)

    def _update_plan(self, now: float, at: Planning) -> None:
        if not self._pathless.running:
            self._pathless.start(now)
        self._progress.wait(now)
        at.plan.update(now)
        self.goal = replace(self.goal, target=at.plan.goal.target)  # in the global frame, for all later plans
        if at.plan.tried_in_vain:
            self._stop(now, at.drive)
        if not at.plan.task.done:
            return
        result = at.plan.task.ended_with()
        if result.path is not None:
            self._pathless.reset()
            self._ways.restart()
            self._follow(result.path, same_goal=False)
            period = self._replan_period()
            self._replan_pacer.postpone(now, period if math.isfinite(period) else 0.0)
            return
        self._stop(now, at.drive)
        self._recover_or_end(result.outcome, result.message, result.cause)

    def _plan_anew(self, now: float) -> None:
        self._at = planning = Planning(self._new_plan(self._ways.tolls(now)))
        self._update_plan(now, planning)

    # driving

    def _follow(self, path: Path, same_goal: bool) -> None:
        goal = FollowGoal(path, self.goal.controller, slot=0, same_goal=same_goal)
        self._at = Driving(self._navigator.exe_path(goal, owner=self.task), path)

    def _update_drive(self, now: float, at: Driving) -> None:
        for feedback in self._pass_on_feedback(at.drive):
            if self._at is at:
                self._watch_progress(now, feedback, at)
        if self._at is not at:
            return
        if at.drive.done:
            self._take_end_of_drive(at)
        else:
            self._update_replan(now, at)

    def _take_end_of_drive(self, at: Driving) -> None:
        self._drop_replan(at)
        result, ending = at.drive.ended_with(), at.drive.ending
        if ending is Ending.SUCCEEDED:
            self._end(Ending.SUCCEEDED, NavigateOutcome.SUCCESS, 'Action "move_base" succeeded!')
        elif ending is Ending.CANCELED:
            message = f"The path of this goal was taken off the controller: {result.message}"
            self._end(Ending.CANCELED, NavigateOutcome.CANCELED, message)
        else:
            self._recover_or_end(result.outcome, result.message, result.cause)

    def _pass_on_feedback(self, drive: Task[FollowResult]) -> List[FollowFeedback]:
        passed_on = []
        for feedback in drive.take_feedback():
            if self._replan_trouble:
                text = "; ".join(filter(None, (feedback.message, self._replan_trouble)))
                feedback = replace(feedback, message=text)
            self._last = feedback
            self.task.add_feedback(feedback)
            passed_on.append(feedback)
        return passed_on

    def _watch_progress(self, now: float, feedback: FollowFeedback, at: Driving) -> None:
        self._ways.watch(now, feedback, at.path, self._navigator.parameters.controller_frequency)
        message = self._progress.trouble(now, feedback, self._navigator.parameters)
        if message:
            self._stop_driving(now, at)
            self._recover_or_end(NavigateOutcome.OSCILLATION, message)

    # replanning

    def _replan_period(self) -> float:
        frequency = self._navigator.parameters.planner_frequency
        return 1.0 / frequency if frequency > 0.0 else math.inf

    def _update_replan(self, now: float, at: Driving) -> None:
        if at.replan is None:
            period = self._replan_period()
            if not (math.isfinite(period) and self._replan_pacer.is_due(now)):
                return
            self._replan_pacer.passed(now, period)  # before any return, or `due` would stay in the past
            if self._last.distance <= NO_REPLAN_WITHIN:
                self._replan_trouble = ""
                return
            at.replan = self._new_plan(self._ways.tolls(now), retry=False)
        at.replan.update(now)
        if at.replan.task.done:
            replan, at.replan = at.replan, None
            self._take_replan(now, at, replan.task.ended_with())

    def _take_replan(self, now: float, at: Driving, result: PlanResult) -> None:
        if result.path is not None:
            self._replan_trouble = ""
            if self._ways.takes(now, at.path, result.path, self._last.pose):
                self._follow(result.path, same_goal=True)
            return
        trouble = f"{result.outcome.name}: {result.message}"
        self._replan_trouble = f"replanning failed, going on along the last path: {trouble}"
        if self._ways.is_blocked(at.path, self._last.pose):
            self._stop_driving(now, at)
            if self._recover(result.outcome, result.message, result.cause):
                return
            if self._navigator.parameters.ends_a_drive(self._ways.refused):
                self._end(Ending.ABORTED, result.outcome, result.message)
            else:
                self._plan_anew(now)  # it waits for missing data and tries again, which the replan did not

    # recovering

    def _recover_or_end(self, outcome: Enum, message: str, cause: Optional[Enum] = None) -> None:
        """Begin the next recovery behaviour that can change the failure; end with the failure where there is none."""
        if not self._recover(outcome, message, cause):
            self._end(Ending.ABORTED, outcome, message)

    def _recover(self, outcome: Enum, message: str, cause: Optional[Enum] = None) -> bool:
        """Begin the next recovery behaviour that can change the failure; return whether there is one.

        Args:
            outcome: Outcome of planning or driving.
            message: Its text.
            cause: With PAT_EXCEEDED, the outcome of the last failed try.
        """
        navigator, where = self._navigator, self._where()[0]
        index = self._next_behavior(outcome, cause, where.pose if where is not None else None)
        if index is None:
            return False
        name = self._behaviors[index]
        self._at = Recovering(navigator.new_recovery(RecoverGoal(name), self.goal.controller))
        if navigator.recovery_watcher is not None:
            navigator.recovery_watcher(name, index, len(self._behaviors), where, self._why(outcome, message))
        return True

    def _next_behavior(self, outcome: Enum, cause: Optional[Enum], pose: Optional[Pose2D]) -> Optional[int]:
        """Return the index of the next behaviour after a failure with the robot at `pose`; None where none helps."""
        navigator = self._navigator
        change = recoverable(outcome, cause)
        moves_nothing = outcome is ControlOutcome.ROBOT_STUCK and navigator.robot.unheard
        if not navigator.parameters.recovery_enabled or change is Recoverable.NO or moves_nothing:
            return None

        def suits(name: str) -> bool:
            return can_change(change, navigator.recoveries.plugin(name), navigator.costmaps["global"])

        progress = navigator.parameters.oscillation_distance
        return self._tried.next(pose, progress, suits, navigator.robot.knows_its_motion)

    def _why(self, outcome: Enum, message: str) -> str:
        """Return a failure as text: the plugin, the outcome and the plugin's message."""
        goal, navigator = self.goal, self._navigator
        whose = "move_base"
        if isinstance(outcome, PlanOutcome):
            whose = f"planner '{goal.planner or navigator.planners.names[0]}'"
        elif isinstance(outcome, ControlOutcome):
            whose = f"controller '{goal.controller or navigator.controllers.names[0]}'"
        return f"{whose}: {outcome.name}: {message}"

    def _update_recovery(self, now: float, at: Recovering) -> None:
        at.recovery.update(now)
        if not at.recovery.task.done:
            return
        result = at.recovery.task.ended_with()
        if result.outcome is not RecoveryOutcome.SUCCESS and self._navigator.failure_watcher is not None:
            self._navigator.failure_watcher(f"recovery ended {result.outcome.name}: {result.message}")
        if result.outcome is RecoveryOutcome.INTERNAL_ERROR:
            self._recovery_fault = result.message
        self._progress.restart(now)
        self._ways.refused = 0
        self._plan_anew(now)

    # ending

    def _drop_replan(self, at: Driving) -> None:
        self._replan_trouble = ""
        if at.replan is not None:
            at.replan.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "the drive is over")

    def _stop_driving(self, now: float, at: Driving) -> None:
        self._stop(now, at.drive)
        self._drop_replan(at)

    def _stop(self, now: float, drive: Optional[Task[FollowResult]]) -> None:
        if drive is not None and not drive.done:
            drive.cancel()
            self._navigator.update_drive(now)

    def _cancel(self, now: float, at: Union[Planning, Driving, Recovering]) -> None:
        part = at.plan if isinstance(at, Planning) else at.recovery if isinstance(at, Recovering) else None
        if part is not None and not part.task.done:
            part.task.cancel()
            part.update(now)
        if isinstance(at, Planning):
            self._stop(now, at.drive)
        elif isinstance(at, Driving):
            self._stop_driving(now, at)
        self._end(Ending.CANCELED, NavigateOutcome.CANCELED, "move_base was cancelled")

    def _end(self, ending: Ending, outcome: Enum, message: str) -> None:
        pose, distance, angle = self._where()
        if ending is Ending.ABORTED:  # add the exception of a behaviour, which the failure itself does not tell
            message = "; ".join(filter(None, (message, self._recovery_fault)))
        self.task.end(ending, NavigateResult(outcome, message, pose, distance, angle))
        self._at = Done()

    def _where(self) -> Tuple[Optional[FramedPose], float, float]:
        frame = self._navigator.parameters.global_frame
        robot = self._navigator.robot
        try:
            pose = robot.pose_in(frame)
            target = robot.transform(frame, self.goal.target.frame).compose(self.goal.target.pose)
        except TransformError:
            return self._last.pose, self._last.distance, self._last.angle
        return FramedPose(pose, frame), pose.distance_to(target), abs(angle_between(pose.theta, target.theta))
