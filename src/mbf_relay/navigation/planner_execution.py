"""Execution of get_path: frames, retries, patience and cancelling of one plan."""

from __future__ import annotations

import dataclasses
import math
from numbers import Real
from typing import Any, Callable, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.navigation.goals import FramedPose, PlanGoal, PlanResult
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.refused_places import plan_round
from mbf_relay.navigation.registry import PluginInstance
from mbf_relay.navigation.robot import Robot
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.worker import Job
from mbf_relay.outcomes import PlanningError, PlanOutcome, TransformError
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner
from mbf_relay.timing import UNSEEN, Pacer, Stopwatch

RETRY_DELAY = 0.2
"""Seconds between two tries: costmaps change no faster, and a plan that fails at once must not keep a core busy."""
STARTING_PATIENCE = 20.0
"""Seconds that a goal waits for a costmap's first update: the relay's default server_timeout."""
RETURNS_WITHIN = 0.1
"""Seconds within which a planner normally returns from a call that was given up; the robot is stopped after that."""

PlanWatcher = Callable[[str, Path], None]
"""Called with a planner's name and the path it found."""

HOPELESS = (PlanOutcome.INVALID_START, PlanOutcome.INVALID_GOAL, PlanOutcome.OUT_OF_MAP, PlanOutcome.CANCELED)
"""Outcomes that are not retried, since waiting changes nothing."""


class PlannerExecution:
    """Finds one path; advanced by `update` until its task is done.

    The planner is called on the worker. Behaviour as mbf_abstract_nav's AbstractPlannerExecution and PlannerAction:
    failures are retried up to planner_max_retries times and for planner_patience seconds, and a planner that does not
    return is given up after that. A planner still busy with a call that was given up is waited for.

    It differs in one point: patience counts from when the robot lost its path, over all executions and the recoveries
    between them (`pathless`), where Move Base Flex starts over with each. An execution that begins when patience is
    over already makes one try, on a costmap updated since then, and ends with its outcome.

    Args:
        goal: What to plan, already validated. Its target is transformed to the costmap's frame once, as soon as the
            transform is there.
        instance: The planner; None only if the task is done already.
        robot: Gives transforms and the robot's pose.
        costmap: The planner's costmap; `planning_trouble(now)` and `snapshot()` are used.
        parameters: Returns the present parameters.
        task: Ends with the result.
        retry: Whether to retry; replans while driving do not.
        watcher: Called with each path found.
        pathless: Runs since the robot has had no path; its time counts as patience used before this execution.

    Attributes:
        tried_in_vain: Whether a try has failed, or something needed for planning was missing; the robot then stops.
    """

    def __init__(
        self, goal: PlanGoal, instance: Optional[PluginInstance[Planner]], robot: Robot, costmap: Any,
        parameters: Callable[[], NavigatorParameters], task: Task[PlanResult], retry: bool = True,
        watcher: Optional[PlanWatcher] = None, pathless: Optional[Stopwatch] = None,
    ) -> None:
        self.goal, self.task = goal, task
        self.tried_in_vain = False
        self._instance = instance
        self._watcher = watcher
        self._robot, self._costmap, self._parameters = robot, costmap, parameters
        self._retry = retry
        self._cancellation = Cancellation()
        self._job: Optional[Job] = None
        self._waiting, self._since_call = Stopwatch(), Stopwatch()
        self._pacer = Pacer()
        self._retries = 0
        self._last_failure = ""
        self._cause: Optional[PlanOutcome] = None
        self._patience_end = math.inf
        self._asked = -math.inf  # time (s) of the first update
        self._seen_at = math.inf  # stamp (s) of the last snapshot that was planned on
        self._pathless, self._waited = pathless or Stopwatch(), 0.0  # and its time (s) at the first update

    @property
    def instance(self) -> PluginInstance[Planner]:
        """The planner."""
        assert self._instance is not None
        return self._instance

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a job."""
        if self.task.done:
            return math.inf
        return self._patience_end if self._job is not None else self._pacer.next

    def update(self, now: float) -> None:
        """Collect the last try, if it is done, and begin the next one when it is due."""
        if self.task.done:
            return
        if self._asked == -math.inf:
            self._asked, self._waited = now, self._pathless.elapsed(now)
        if self.task.cancel_requested:
            self.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "Planning was cancelled")
            return
        if self._job is not None and self._job.done:
            self._collect(now)
        if not self.task.done and self._patience_exceeded(now):
            self._run_out_of_patience()
        if not self.task.done and self._job is None and self._pacer.is_due(now):
            self._begin(now)

    def give_up(
        self, ending: Ending, outcome: PlanOutcome, message: str, cause: Optional[PlanOutcome] = None
    ) -> None:
        """End now and cancel the planner; what it still returns is dropped."""
        self._cancellation.cancel()
        self.task.end(ending, PlanResult(outcome, message, cause=cause))

    def _begin(self, now: float) -> None:
        if self.instance.busy:
            self._start_patience(now)
            self.tried_in_vain = self._since_call.elapsed(now) > RETURNS_WITHIN
            self._last_failure = f"planner '{self.instance.name}' is still busy with an earlier call that was given up"
            self._pacer.postpone(now, 0.01)
            return
        if now - self._pacer.next > max(UNSEEN, self._parameters().planning_tf_timeout):
            self._waiting.start(now)
        try:
            trouble = self._costmap.planning_trouble(now)
            if trouble is not None:
                raise trouble
            start, goal = self._locate()
        except TransformError as error:
            self._wait_for(now, PlanOutcome.TF_ERROR, str(error))
            return
        except PlanningError as error:
            self._wait_for(now, error.outcome, error.message)
            return
        snapshot = self._costmap.snapshot()
        self._seen_at = snapshot.stamp
        self._start_patience(now)
        tolerance, cancelled = self.goal.tolerance, self._cancellation
        tolls = self.goal.tolls if snapshot.frame == self._parameters().global_frame else ()

        def search(planner: Planner) -> Path:
            return plan_round(
                tolls, snapshot, start, goal,
                lambda seen: usable(planner.plan(seen, start, goal, tolerance, cancelled), self.instance.name))

        self._job = self.instance.call(search)
        if self._job.done:
            self._collect(now)

    def _locate(self) -> Tuple[Pose2D, Pose2D]:
        frame = self._costmap.frame
        start = self._robot.pose_in(frame) if self.goal.start is None else self._in_frame(self.goal.start, frame)
        target = self._in_frame(self.goal.target, frame)
        # kept from now on: a target in a frame that moves with the robot, such as base_link, would move along with it
        if self.goal.target.frame != frame:
            self.goal = dataclasses.replace(self.goal, target=FramedPose(target, frame))
        return start, target

    def _in_frame(self, pose: FramedPose, frame: str) -> Pose2D:
        if pose.frame == frame:
            return pose.pose
        return self._robot.transform(frame, pose.frame).compose(pose.pose)

    def _wait_for(self, now: float, outcome: PlanOutcome, message: str) -> None:
        self.tried_in_vain = True
        if not self._waiting.running:
            self._waiting.start(now)
        patience = self._parameters().planning_tf_timeout
        if outcome is PlanOutcome.NOT_INITIALIZED:  # the server has just started; move_base takes no goals until then
            patience = max(patience, STARTING_PATIENCE)
        if not self._retry or self._waiting.elapsed(now) >= patience:
            self.give_up(Ending.ABORTED, outcome, message)
        else:
            self._pacer.postpone(now, 0.05)

    def _collect(self, now: float) -> None:
        job, self._job = self._job, None
        assert job is not None
        try:
            path = self._in_global_frame(job.result())
        except PlanningError as error:
            self._fail(now, error)
        except Exception as error:  # a plugin may raise anything; that ends the goal, not the server
            self.give_up(
                Ending.ABORTED, PlanOutcome.INTERNAL_ERROR,
                f"planner '{self.instance.name}' failed with {self.instance.failure_text(error)}",
            )
        else:
            if self._watcher is not None:
                self._watcher(self.instance.name, path)
            cost = path.cost if path.cost != 0.0 else path.length
            self.task.end(
                Ending.SUCCEEDED,
                PlanResult(PlanOutcome.SUCCESS, f"Path of {len(path)} poses, {path.length:.2f} m", path, cost),
            )

    def _in_global_frame(self, path: Path) -> Path:
        frame = self._parameters().global_frame
        if path.frame == frame:
            return path
        try:
            poses = self._robot.transform(frame, path.frame).transform_poses(path.poses)
        except TransformError as error:
            name = self.instance.name
            raise PlanningError(PlanOutcome.TF_ERROR, f"the path that planner '{name}' returned: {error}") from error
        return Path(poses, frame, path.cost)

    def _fail(self, now: float, error: PlanningError) -> None:
        parameters = self._parameters()
        is_last_try = 0.0 < parameters.planner_patience <= self._waited
        if (error.outcome is PlanOutcome.OUT_OF_MAP or is_last_try) and self._seen_at < self._asked:
            # a rolling window, a growing map or a cleared costmap may change with its next update
            self._wait_for(now, error.outcome, error.message)
            return
        self._waiting.reset()  # nothing is missing at present
        retries = parameters.planner_max_retries
        self._retries, self.tried_in_vain = self._retries + 1, True
        self._last_failure, self._cause = error.message, error.outcome
        if not self._retry or 0 <= retries < self._retries or is_last_try or error.outcome in HOPELESS:
            self.give_up(Ending.ABORTED, error.outcome, error.message)
        else:
            self._pacer.postpone(now, RETRY_DELAY)

    def _start_patience(self, now: float) -> None:
        if not self._since_call.running:
            self._since_call.start(now)
            self._patience_end = now + (self._parameters().planner_patience or math.inf)

    def _patience_exceeded(self, now: float) -> bool:
        patience = self._parameters().planner_patience
        waited = self._waited if self._retries else 0.0
        return patience > 0.0 and self._since_call.elapsed(now) + waited >= patience

    def _run_out_of_patience(self) -> None:
        why = self._last_failure or f"planner '{self.instance.name}' has not returned"
        message = f"Planner patience of {self._parameters().planner_patience:g} s exceeded: {why}"
        self.give_up(Ending.ABORTED, PlanOutcome.PAT_EXCEEDED, message, self._cause)


def usable(answer: Any, name: str) -> Path:
    """Check what a planner plugin returned and return it as a path with poses of float64, shape (N, 3).

    Args:
        answer: What it returned; anything.
        name: The planner's name, for errors.

    Raises:
        TypeError: It is no Path, its poses or cost are no numbers, or its frame is no string.
        ValueError: Its poses have another shape, or poses or cost are not finite.
        PlanningError: EMPTY_PATH.
    """
    if not isinstance(answer, Path):
        raise TypeError(f"it returned {type(answer).__name__}, not a path")
    if not isinstance(answer.frame, str):
        raise TypeError(f"it returned a path whose frame is {answer.frame!r}, not a name")
    if not isinstance(answer.cost, Real):
        raise TypeError(f"it returned a path whose cost is {answer.cost!r}, not a number")
    try:
        poses = np.asarray(answer.poses, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"it returned a path whose poses are no numbers: {error}") from error
    if poses.size == 0:
        raise PlanningError(PlanOutcome.EMPTY_PATH, f"planner '{name}' returned an empty path")
    if poses.ndim != 2 or poses.shape[1] != 3:
        raise ValueError(f"it returned a path with poses of shape {poses.shape}, not (N, 3)")
    if not (np.isfinite(poses).all() and math.isfinite(answer.cost)):
        raise ValueError("it returned a path with poses or a cost that are not finite")
    return answer if poses is answer.poses else dataclasses.replace(answer, poses=poses)
