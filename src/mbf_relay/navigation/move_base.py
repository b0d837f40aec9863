"""move_base: plan, drive, recover, and all over again, until the robot is there or nothing is left to try."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Any, Callable, Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid
from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.navigation.goals import (
    FollowFeedback, FollowGoal, FollowResult, FramedPose, NavigateGoal, NavigateOutcome, NavigateResult, PlanGoal,
    RecoverGoal,
)
from mbf_relay.navigation.planner_execution import PlannerExecution
from mbf_relay.navigation.progress import OscillationDetector
from mbf_relay.navigation.recovery_execution import RecoveryExecution
from mbf_relay.navigation.remedies import Remedy, remedy_for
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.timing import Pacer
from mbf_relay.navigation.trials import Trials
from mbf_relay.navigation.way_keeper import WayKeeper
from mbf_relay.outcomes import ControlOutcome, PlanOutcome, StaleDataError, TransformError
from mbf_relay.planning.path import Path

if TYPE_CHECKING:
    from mbf_relay.navigation.navigator import Navigator

NO_REPLAN_WITHIN = 0.1
"""Metres to the goal below which the path stays as it is."""


RecoveryWatcher = Callable[[str, int, int, Optional[FramedPose]], None]
"""Told of each recovery that begins: its behaviour, that one's place in the list (from 0), the list's length, the robot."""


class MoveBase:
    """One move_base goal; advanced by `update` until its task is done.

    Behaviour as mbf_abstract_nav's MoveBaseAction: it plans, drives in slot 0 of exe_path, replans at planner_frequency
    while driving, and after a failure runs the next recovery behaviour and plans again. It deviates in two things: what
    no behaviour can change ends the goal at once (`remedies` says what and why), and the list of behaviours starts over
    where the robot has got elsewhere, not with each path that is found (`Trials`). While a new goal is planned, the
    robot goes on along the path of the one it replaced.

    Args:
        goal: Where to go.
        navigator: Gives planners, the drive of slot 0 and recoveries.
        task: Ends with the result.
        driving: The drive of the move_base goal this one replaces, if it still goes on.
    """

    def __init__(
        self, goal: NavigateGoal, navigator: "Navigator", task: "Task[NavigateResult]",
        driving: "Optional[Task[FollowResult]]" = None,
    ) -> None:
        self.goal, self.task = goal, task
        self._navigator = navigator
        self._plan: Optional[PlannerExecution] = None
        self._replan: Optional[PlannerExecution] = None
        self._driving = driving
        self._drives_here = False
        self._recovery: Optional[RecoveryExecution] = None
        self._behaviors: Tuple[str, ...] = goal.recovery_behaviors or tuple(navigator.recoveries.names)
        self._trials, self._ways = Trials(self._behaviors), WayKeeper()
        self._oscillation = OscillationDetector()
        self._replan_pacer = Pacer()
        self._replan_trouble = ""
        self._last = FollowFeedback(ControlOutcome.SUCCESS, "")
        self._path: Optional[Path] = None
        self._started = False

    @property
    def driving(self) -> "Optional[Task[FollowResult]]":
        """The drive that goes on, if any."""
        return self._driving if self._driving is not None and not self._driving.done else None

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a job."""
        if self.task.done:
            return math.inf
        if not self._started:
            return -math.inf
        parts = [part.due for part in (self._plan, self._replan, self._recovery) if part is not None]
        if self._drives_here and self._replan is None and self._navigator.parameters.planner_frequency > 0.0:
            parts.append(self._replan_pacer.next)
        return min(parts, default=math.inf)

    def replaced(self) -> None:
        """End because a new goal takes over; its drive goes on until the new goal has a path."""
        for part in (self._plan, self._replan):
            if part is not None and not part.task.done:
                part.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "Goal preempted by a new goal")
        if self._recovery is not None and not self._recovery.task.done:
            self._recovery.replaced()
        self._end(Ending.CANCELED, NavigateOutcome.CANCELED, "Goal preempted by a new goal")

    def update(self, now: float) -> None:
        """Advance whatever it is at."""
        if self.task.done:
            return
        if not self._started:
            self._started = True
            self._oscillation.restart(now)
            self._plan_again()
        if self.task.cancel_requested:
            self._cancel(now)
        elif self._plan is not None:
            self._update_plan(now)
        elif self._recovery is not None:
            self._update_recovery(now)
        else:
            self._update_drive(now)

    # planning

    def _plan_again(self) -> None:
        self._plan = self._navigator.new_plan(PlanGoal(self.goal.target, planner=self.goal.planner))

    def _update_plan(self, now: float) -> None:
        self._pass_on_feedback(now, watch=False)
        plan = self._plan
        plan.update(now)
        if not plan.task.done:
            return
        self._plan = None
        result = plan.task.result
        if plan.task.ending is Ending.SUCCEEDED:
            self._ways.restart()
            self._follow(result.path, same_goal=False)
            period = self._replan_period()
            self._replan_pacer.postpone(now, period if math.isfinite(period) else 0.0)
            return
        self._stop_driving(now)
        if plan.task.ending is Ending.REJECTED or not self._recover(result.outcome, result.cause):
            self._fail(plan.task.ending, result.outcome, result.message)

    # driving

    def _follow(self, path: Path, same_goal: bool) -> None:
        self._path = path
        goal = FollowGoal(path, self.goal.controller, slot=0, same_goal=same_goal)
        self._driving = self._navigator.exe_path(goal, watch_oscillation=False)
        self._drives_here = True

    def _update_drive(self, now: float) -> None:
        drive = self._driving
        self._pass_on_feedback(now, watch=True)
        if self.task.done or self._plan is not None or self._recovery is not None:
            return
        if drive.done:
            self._take_end_of_drive(now, drive)
            return
        self._update_replan(now)

    def _take_end_of_drive(self, now: float, drive: "Task[FollowResult]") -> None:
        self._forget_drive()
        result = drive.result
        if drive.ending is Ending.SUCCEEDED:
            self._end(Ending.SUCCEEDED, NavigateOutcome.SUCCESS, 'Action "move_base" succeeded!')
        elif drive.ending is Ending.CANCELED:
            message = f"The path of this goal was taken off the controller: {result.message}"
            self._end(Ending.CANCELED, NavigateOutcome.CANCELED, message)
        elif drive.ending is Ending.REJECTED or not self._recover(result.outcome, result.cause):
            self._fail(drive.ending, result.outcome, result.message)

    def _pass_on_feedback(self, now: float, watch: bool) -> None:
        if self._driving is None:
            return
        for feedback in self._driving.take_feedback():
            if self._replan_trouble:
                text = "; ".join(filter(None, (feedback.message, self._replan_trouble)))
                feedback = FollowFeedback(feedback.outcome, text, *_rest(feedback))
            self._last = feedback
            self.task.add_feedback(feedback)
            if watch and not self.task.done:
                self._watch_oscillation(now, feedback)

    def _watch_oscillation(self, now: float, feedback: FollowFeedback) -> None:
        parameters = self._navigator.parameters
        if feedback.pose is None or parameters.oscillation_timeout <= 0.0:
            return
        if self._oscillation.progressed(now, feedback.pose.pose, parameters):
            return
        stuck = self._oscillation.stuck_for(now, parameters)
        if stuck is not None and self._recovery is None:
            self._stop_driving(now)
            if not self._recover(NavigateOutcome.OSCILLATION):
                self._end(Ending.ABORTED, NavigateOutcome.OSCILLATION, f"Robot is oscillating for {stuck:.1f} s!")

    # replanning

    def _replan_period(self) -> float:
        frequency = self._navigator.parameters.planner_frequency
        return 1.0 / frequency if frequency > 0.0 else math.inf

    def _update_replan(self, now: float) -> None:
        if self._replan is not None:
            self._replan.update(now)
            if self._replan.task.done:
                self._take_replan(now)
            return
        period = self._replan_period()
        if not (math.isfinite(period) and self._replan_pacer.is_due(now)):
            return
        self._replan_pacer.passed(now, period)  # also where nothing is to be done, or `due` would stay in the past
        if self._last.distance <= NO_REPLAN_WITHIN:
            return
        goal = PlanGoal(self.goal.target, planner=self.goal.planner)
        self._replan = self._navigator.new_plan(goal, retry=False)
        self._replan.update(now)
        if self._replan.task.done:
            self._take_replan(now)

    def _take_replan(self, now: float) -> None:
        replan, self._replan = self._replan, None
        result = replan.task.result
        if replan.task.ending is Ending.SUCCEEDED:
            self._replan_trouble = ""
            if self._is_worth_following(now, result.path):
                self._follow(result.path, same_goal=True)
            return
        self._replan_trouble = f"replanning failed, going on along the last path: {result.outcome.name}: {result.message}"
        if self._is_path_blocked():
            self._replan_trouble = ""
            self._stop_driving(now)
            if not self._recover(result.outcome, result.cause):
                self._fail(Ending.ABORTED, result.outcome, result.message)

    def _is_worth_following(self, now: float, path: Path) -> bool:
        """Tell whether to go over to a path found while driving along another one."""
        if self._last.pose is None or self._last.pose.frame != path.frame or self._path.frame != path.frame:
            return True
        width = 2.0 * self._navigator.costmaps["global"].snapshot().half_width
        wanted = self._ways.wants(now, self._path.poses, path.poses, self._last.pose.pose, width)
        return wanted or self._is_path_blocked()

    def _is_path_blocked(self) -> bool:
        """Tell whether an obstacle lies on what is left of the last path."""
        costmap = self._navigator.costmaps["global"]
        try:
            snapshot = costmap.snapshot()
            frame_from_path = self._navigator.robot.transform(costmap.frame, self._path.frame)
        except (TransformError, StaleDataError):
            return False
        pose = self._last.pose.pose if self._last.pose is not None else None
        return path_is_blocked(snapshot, frame_from_path.transform_poses(self._path.poses), pose)

    # recovering

    def _recover(self, outcome: Enum, cause: Optional[Enum] = None) -> bool:
        """Begin the next recovery behaviour that can change a failure; tell whether there is one."""
        navigator = self._navigator
        remedy = remedy_for(outcome, cause)
        if not navigator.parameters.recovery_enabled or remedy is Remedy.NONE:
            return False

        def suits(name: str) -> bool:
            return remedy is Remedy.MOVE or not navigator.recoveries.plugin(name).leaves_place

        where = self._where()[0]
        pose = where.pose if where is not None else None
        index = self._trials.next(pose, navigator.parameters.oscillation_distance, suits)
        if index is None:
            return False
        name = self._behaviors[index]
        self._recovery = navigator.new_recovery(RecoverGoal(name), self.goal.controller)
        if navigator.recovery_watcher is not None:
            navigator.recovery_watcher(name, index, len(self._behaviors), where)
        return True

    def _update_recovery(self, now: float) -> None:
        recovery = self._recovery
        recovery.update(now)
        if not recovery.task.done:
            return
        self._recovery = None
        self._oscillation.restart(now)
        self._plan_again()
        self._update_plan(now)

    # ending

    def _forget_drive(self) -> None:
        if self._replan is not None and not self._replan.task.done:
            self._replan.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "the drive is over")
        self._driving, self._replan, self._drives_here = None, None, False

    def _stop_driving(self, now: float) -> None:
        if self.driving is not None:
            self._driving.cancel()
            self._navigator.update_drive(now)
        self._forget_drive()

    def _cancel(self, now: float) -> None:
        for part in (self._plan, self._recovery):
            if part is not None and not part.task.done:
                part.task.cancel()
                part.update(now)
        self._stop_driving(now)
        self._end(Ending.CANCELED, NavigateOutcome.CANCELED, "move_base was cancelled")

    def _fail(self, ending: Ending, outcome: Enum, message: str) -> None:
        self._end(ending if ending is not Ending.SUCCEEDED else Ending.ABORTED, outcome, message)

    def _end(self, ending: Ending, outcome: Enum, message: str) -> None:
        pose, distance, angle = self._where()
        self.task.end(ending, NavigateResult(outcome, message, pose, distance, angle))

    def _where(self) -> Tuple[Optional[FramedPose], float, float]:
        frame = self._navigator.parameters.global_frame
        robot = self._navigator.robot
        try:
            pose = robot.pose_in(frame)
            target = robot.transform(frame, self.goal.target.frame).compose(self.goal.target.pose)
        except TransformError:
            return self._last.pose, self._last.distance, self._last.angle
        return FramedPose(pose, frame), pose.distance_to(target), abs(angle_between(pose.theta, target.theta))


def path_is_blocked(costmap: CostGrid, poses: np.ndarray, robot: Optional[Pose2D]) -> bool:
    """Tell whether a path leads through cells where the robot's centre must not be.

    Args:
        costmap: Where the obstacles are.
        poses: Shape (N, 3), in the costmap's frame.
        robot: What lies behind it does not count; the whole path does where None.
    """
    if robot is not None:
        distances = np.hypot(poses[:, 0] - robot.x, poses[:, 1] - robot.y)
        poses = poses[int(distances.argmin()) + 1:]
    cells = costmap.grid.cells_at(poses)
    cells = cells[costmap.grid.contains_cells(cells)]
    costs = costmap.costs[cells[:, 1], cells[:, 0]]
    return bool(((costs == INSCRIBED) | (costs == LETHAL)).any())


def _rest(feedback: FollowFeedback) -> Tuple[Any, ...]:
    return feedback.pose, feedback.velocity, feedback.distance, feedback.angle

