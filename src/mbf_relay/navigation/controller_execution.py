"""Execution of exe_path: control cycles, retries, patience, stale sensors or poses, and a zero velocity at the end."""

from __future__ import annotations

import dataclasses
import math
import warnings
from typing import Any, Callable, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState, GoalTolerance, SpeedLimit
from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.geometry import STOP, Twist2D, angle_between
from mbf_relay.navigation.control_cycle import ControlAnswer, run_cycle
from mbf_relay.navigation.cycle_load import CycleLoad, CyclePeriod
from mbf_relay.navigation.goals import FollowFeedback, FollowGoal, FollowResult, FramedPose
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.progress import TOLD_AFTER, IgnoredCommands, OscillationDetector
from mbf_relay.navigation.registry import PluginInstance
from mbf_relay.navigation.robot import OVERRUN_PERIODS, TOO_OLD, Robot
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.worker import Job
from mbf_relay.outcomes import ControlError, ControlOutcome, StaleDataError, TransformError
from mbf_relay.planning.path import Path
from mbf_relay.timing import UNSEEN, Pacer, Stopwatch

ZONE = "zone"
"""Name of the source of the costmaps' speed limit zones; see Controller.limit_speed."""
PAUSED = "paused"
"""Message of the feedback while the robot is paused."""
BUSY_DELAY = 0.01
"""Seconds between two checks of a controller that is still busy with a call of an ended drive."""
FINAL = frozenset((
    ControlOutcome.INVALID_PATH, ControlOutcome.ROBOT_STUCK, ControlOutcome.BLOCKED_GOAL, ControlOutcome.MISSED_PATH))
"""Outcomes that are not retried, since the same path would fail again; controllers wait by themselves before them."""


class ControlView(NamedTuple):
    """A cycle's input in the costmap's frame, the pose in the global one, and what is left to the path's end (m, rad).
    """

    state: ControlState
    pose: FramedPose
    distance: float
    angle: float


class ControllerExecution:
    """Drives along one path after the other with one controller; advanced by `update` until its task is done.

    The controller is called on the worker. Behaviour as mbf_abstract_nav's AbstractControllerExecution and
    ControllerAction, but velocities are sent in `update` only, right after the cancel request was checked, and a zero
    velocity is sent before the task ends.

    Args:
        instance: The controller.
        robot: Gives poses and odometry, and takes velocities.
        costmap: The controller's costmap; `stale_reason(now)` and `snapshot()` are used.
        parameters: Returns the present parameters.
        zone_limit: Returns the speed limit at the robot's place.

    Attributes:
        watch_oscillation: Whether to check for oscillation here; False if move_base does, over several drives.
    """

    def __init__(
        self, instance: PluginInstance[Controller], robot: Robot, costmap: Any,
        parameters: Callable[[], NavigatorParameters], zone_limit: Callable[[], ZoneLimit] = ZoneLimit,
    ) -> None:
        self.instance = instance
        self.task: Task[FollowResult] = Task()
        self.watch_oscillation = True
        self._robot, self._costmap, self._parameters, self._zone_limit = robot, costmap, parameters, zone_limit
        self._told_limit: Optional[ZoneLimit] = None
        self._goal: Optional[FollowGoal] = None
        self._path_is_new, self._goal_is_new = False, False
        self._job: Optional[Job] = None
        self._job_task = self.task
        self._view: Optional[ControlView] = None
        self._command = robot.commanded or STOP  # may be another controller's, if this one takes over a moving robot
        self._pacer = Pacer()
        self._since_start, self._since_valid, self._since_call, self._since_pose = (Stopwatch() for _ in range(4))
        self._retries = 0
        self._load, self._cycle_period = CycleLoad(), CyclePeriod()
        self._oscillation, self._ignored = OscillationDetector(), IgnoredCommands()

    @property
    def goal(self) -> Optional[FollowGoal]:
        """The goal driven at present, None before the first."""
        return self._goal

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a job."""
        return math.inf if self.task.done else self._pacer.next

    def follow(self, goal: FollowGoal, task: Task[FollowResult]) -> None:
        """Drive along another path from the next cycle on, without a stop; the running task ends CANCELED.

        A path to a new goal makes a cycle due at once. One to the same goal waits for the next regular cycle, or
        replanning at 5 Hz would raise the control rate from 10 to 15 Hz.
        """
        if self._goal is not None:
            self._end(Ending.CANCELED, ControlOutcome.CANCELED, "Goal preempted by a new plan", stop=False)
        same = goal.same_goal
        if same is None:
            same = self._goal is not None and _same_end(self._goal.path, goal.path)
        is_new = self._goal is None or not same
        self._goal_is_new = is_new or self._goal_is_new
        self._goal, self._path_is_new, self.task = goal, True, task
        if is_new:
            self._pacer.hasten()
            self._view = self._view and self._view._replace(distance=math.inf, angle=math.inf)  # of the last goal
        if goal.same_goal is False:  # said by move_base, which gives each of its goals the whole patience
            self._retries, self._since_start, self._since_valid = 0, Stopwatch(), Stopwatch()

    def replaced(self) -> None:
        """End because another goal takes over at once; the robot is stopped only with force_stop_on_cancel."""
        stop = self._parameters().force_stop_on_cancel
        self._end(Ending.CANCELED, ControlOutcome.CANCELED, "Goal preempted by a new goal", stop=stop)

    def update(self, now: float) -> None:
        """Send the velocity of the last cycle, if it is ready, and begin the next cycle when it is due."""
        if self.task.done:
            return
        if not self._since_start.running:
            self._since_start.start(now)
        if self.task.cancel_requested:
            self._end(Ending.CANCELED, ControlOutcome.CANCELED, "Controller canceled")
            return
        if self._robot.paused:
            self._stand_by(now)
            return
        late = now - self._pacer.next
        if UNSEEN < late < math.inf:
            self._start_over(now, late)
            self._no_command(now, ControlOutcome.NO_VALID_CMD, f"control cycles came to a stop for {late:.1f} s")
        if self._job is not None:
            self._watch(now, self._job)
        if not self.task.done and self._job is None and self._pacer.is_due(now):
            self._begin(now)

    def _stand_by(self, now: float) -> None:
        """Stop the robot and restart all timeouts while it is paused."""
        self._start_over(now)
        if self._command != STOP:  # send zero once only: somebody may drive it by hand meanwhile
            self._send(STOP)
        if self._pacer.is_due(now):
            self._pacer.passed(now, 1.0 / self._parameters().controller_frequency)
            self._report(ControlOutcome.SUCCESS, PAUSED)

    def _start_over(self, now: float, late: float = math.inf) -> None:
        """Leave `late` (s) out of patience, or all, restart other timeouts, and drop the answer of a running cycle."""
        self._job_task = Task()  # matches no drive, see _collect
        for watch in (self._since_start, self._since_valid):
            watch.leave_out(min(late, watch.elapsed(now)))
        self._since_call.start(now)
        self._since_pose.reset()
        self._oscillation.restart(now)

    # one cycle

    def _begin(self, now: float) -> None:
        assert self._goal is not None
        period = 1.0 / self._parameters().controller_frequency
        self._pacer.passed(now, period)
        if self.instance.busy:
            message = f"controller '{self.instance.name}' is still busy with an earlier call that was given up"
            self._no_command(now, ControlOutcome.PAT_EXCEEDED, message)
            self._pacer.postpone(now, BUSY_DELAY)
            return
        try:
            self._view = view = self._look(now, self._cycle_period.note(now, period))
        except TransformError as error:
            self._blind(now, error)
            return
        except StaleDataError as error:
            self._no_command(now, ControlOutcome.NO_VALID_CMD, str(error))
            return
        self._since_pose.reset()
        path, tolerance = self._goal.path if self._path_is_new else None, self._goal.tolerance
        goal_is_new, self._path_is_new, self._goal_is_new = self._goal_is_new, False, False
        self._since_call.start(now)
        self._job_task = self.task
        limit = self._zone_limit()
        told, self._told_limit = self._told_limit, limit

        def cycle(controller: Controller) -> ControlAnswer:
            if limit != told:
                controller.limit_speed(SpeedLimit(limit.speed, share=limit.share), ZONE)
            return run_cycle(controller, view.state, path, goal_is_new, tolerance)

        self._job = self.instance.call(cycle)
        if self._job.done:
            self._collect(now)

    def _look(self, now: float, period: float) -> ControlView:
        frame = self._costmap.frame
        pose = self._robot.pose_in(frame)
        velocity = self._robot.velocity()
        stale = self._costmap.stale_reason(now)
        if stale:
            raise StaleDataError(stale)
        global_frame = self._parameters().global_frame
        path = self._fixed_path(global_frame)
        costmap_from_path = self._robot.transform(frame, path.frame)
        pose_in_path = pose.relative_to(costmap_from_path)
        global_pose = pose_in_path if path.frame == global_frame else self._robot.pose_in(global_frame)
        self._robot.note_motion(now, velocity)
        snapshot = self._costmap.snapshot()
        here = self._robot.caught_up(pose, frame)
        state = ControlState(
            now, self._robot.expected_in(here, snapshot), velocity, snapshot, costmap_from_path, period,
            self._robot.commanded, self._robot.delay.seconds, here, self._robot.delay.told_lately())
        goal = path.goal
        return ControlView(
            state, FramedPose(global_pose, global_frame), pose_in_path.distance_to(goal),
            abs(angle_between(pose_in_path.theta, goal.theta)),
        )

    def _fixed_path(self, global_frame: str) -> Path:
        """Return the path; transform one in a frame that may move with the robot to the global frame, once."""
        assert self._goal is not None
        path = self._goal.path
        if path.frame not in (self._costmap.frame, global_frame):
            poses = self._robot.transform(global_frame, path.frame).transform_poses(path.poses)
            path = Path(poses, global_frame, path.cost)
            self._goal = dataclasses.replace(self._goal, path=path)
        return path

    def _watch(self, now: float, job: Job) -> None:
        """Collect the running cycle if it is done; else stop the robot when it takes too long, or end the drive."""
        if job.done:
            self._collect(now)
            return
        parameters = self._parameters()
        elapsed = self._since_call.elapsed(now)
        patience = parameters.controller_patience
        if patience > 0.0 and elapsed > patience:
            name = self.instance.name
            message = f"Controller '{name}' has not returned for {elapsed:.1f} s; its patience is {patience:g} s"
            self._end(Ending.ABORTED, ControlOutcome.PAT_EXCEEDED, message)
        elif elapsed > OVERRUN_PERIODS / parameters.controller_frequency and self._command != STOP:
            self._send(STOP)
        if not self.task.done and self._pacer.is_due(now):
            self._pacer.passed(now, 1.0 / parameters.controller_frequency)

    def _collect(self, now: float) -> None:
        job, self._job = self._job, None
        assert job is not None
        if self._job_task is not self.task:  # the path was replaced meanwhile: begin its first cycle at once
            self._pacer.hasten()
            return
        try:
            answer = job.result()
            velocity = Twist2D.of(answer.velocity)
        except ControlError as error:
            if error.outcome in FINAL:
                self._end(Ending.ABORTED, error.outcome, error.message)
            else:
                self._fail(now, error.outcome, error.message)
        except Exception as error:  # a plugin may raise anything; that ends the goal, not the server
            message = f"controller '{self.instance.name}' failed with {self.instance.failure_text(error)}"
            self._end(Ending.ABORTED, ControlOutcome.INTERNAL_ERROR, message)
        else:
            if answer.arrived or self._arrived():
                self._end(Ending.SUCCEEDED, ControlOutcome.SUCCESS, "Controller succeeded; arrived at goal!")
            elif not velocity.is_a_robots():
                told = f"controller '{self.instance.name}' returned velocity {tuple(velocity)}, which no robot drives"
                self._fail(now, ControlOutcome.NO_VALID_CMD, told)
            elif self._since_call.elapsed(now) > TOO_OLD:
                late = f"computed for {self._since_call.elapsed(now):.1f} s, and what it saw is too old to drive by"
                self._no_command(now, ControlOutcome.NO_VALID_CMD, f"controller '{self.instance.name}' {late}")
            else:
                self._drive(now, velocity)

    def _arrived(self) -> bool:
        """Return whether the goal is reached by the server's own tolerances, with mbf_tolerance_check."""
        parameters = self._parameters()
        if not parameters.mbf_tolerance_check:
            return False
        assert self._goal is not None and self._view is not None
        tolerance = GoalTolerance.of(self._goal.tolerance, parameters.dist_tolerance, parameters.angle_tolerance)
        return self._view.distance < tolerance.distance and self._view.angle < tolerance.angle

    def _drive(self, now: float, velocity: Twist2D) -> None:
        parameters = self._parameters()
        if self.task.cancel_requested:  # it may have come while the controller computed
            self._end(Ending.CANCELED, ControlOutcome.CANCELED, "Controller canceled")
            return
        assert self._view is not None
        velocity = self._at_the_machines_pace(now, velocity)
        self._send(velocity)
        self._since_valid.start(now)
        self._retries = 0
        ignored = self._ignored.ignored_for(now, velocity, self._view.state.velocity, self._view.pose.pose)
        if 0.0 < parameters.cmd_vel_ignored_tolerance < ignored:
            self._end(Ending.ABORTED, ControlOutcome.ROBOT_STUCK, self._ignored.told(now, velocity))
            return
        self._oscillation.progressed(now, self._view.pose.pose, parameters)
        stuck = self._oscillation.stuck_for(now, parameters) if self.watch_oscillation else None
        if stuck is not None:
            message = f"Oscillation detected! No progress for {stuck:.1f} s"
            self._end(Ending.ABORTED, ControlOutcome.OSCILLATION, message)
            return
        standing = self._ignored.told(now, velocity) if ignored > TOLD_AFTER else ""
        self._report(ControlOutcome.SUCCESS, self._robot.explained(standing))

    def _at_the_machines_pace(self, now: float, velocity: Twist2D) -> Twist2D:
        """Return the velocity, scaled down along the same arc where cycles take too much of the period (CycleLoad)."""
        period, thinking = 1.0 / self._parameters().controller_frequency, self._since_call.elapsed(now)
        if self._load.note(thinking, period):
            warnings.warn(
                f"controller '{self.instance.name}' computes for {self._load.share:.0%} of its {period:.2f} s period; "
                "the robot drives slower until that is less: lower controller_frequency or the controller's samples",
                RuntimeWarning, stacklevel=1,
            )
        return velocity.scaled(self._load.speed_factor)

    # cycles without a velocity

    def _blind(self, now: float, error: TransformError) -> None:
        """Stop while the robot's pose is unknown; end the drive after control_tf_timeout."""
        if not self._since_pose.running:
            self._since_pose.start(now)
        patience, name = self._parameters().control_tf_timeout
        if self._since_pose.elapsed(now) < patience:
            self._stand(now, ControlOutcome.TF_ERROR, str(error))
        else:
            text = f"Could not get the robot pose for {patience:g} s ({name}): {error}"
            self._end(Ending.ABORTED, ControlOutcome.TF_ERROR, text)

    def _no_command(self, now: float, outcome: ControlOutcome, message: str) -> None:
        """Stop because the controller cannot be called; patience counts, but no retry."""
        if self._patience_exceeded(now):
            self._run_out_of_patience(outcome, message)
        else:
            self._stand(now, outcome, message)

    def _stand(self, now: float, outcome: ControlOutcome, message: str) -> None:
        self._oscillation.wait(now)
        self._send(STOP)
        self._robot.waits_for = message
        self._report(outcome, message)

    def _fail(self, now: float, outcome: ControlOutcome, message: str) -> None:
        parameters = self._parameters()
        self._retries += 1
        retries = parameters.controller_max_retries
        if 0 <= retries < self._retries:
            self._end(Ending.ABORTED, outcome, message)
        elif self._patience_exceeded(now):
            self._run_out_of_patience(outcome, message)
        else:
            slower = self._command.scaled(0.5)
            self._send(STOP if parameters.force_stop_on_retry or slower.speed() < 1e-2 else slower)
            self._report(outcome, message, refused=True)

    def _patience_exceeded(self, now: float) -> bool:
        patience = self._parameters().controller_patience
        since = self._since_valid if self._since_valid.running else self._since_start
        return patience > 0.0 and since.elapsed(now) > patience

    def _run_out_of_patience(self, cause: ControlOutcome, message: str) -> None:
        text = f"Controller patience of {self._parameters().controller_patience:g} s exceeded: {message}"
        self._end(Ending.ABORTED, ControlOutcome.PAT_EXCEEDED, text, cause=cause)

    # what goes out

    def _send(self, velocity: Twist2D) -> None:
        if velocity == STOP:
            self._ignored = IgnoredCommands()  # begin anew: a robot that stands as commanded ignores nothing
        self._command, self._robot.waits_for = velocity, ""
        self._robot.command(velocity)

    def _report(self, outcome: ControlOutcome, message: str, refused: bool = False) -> None:
        pose, distance, angle = self._where()
        self.task.add_feedback(FollowFeedback(
            outcome, message, pose, self._command, distance, angle, self._robot.delay.seconds, refused))

    def _end(
        self, ending: Ending, outcome: ControlOutcome, message: str, stop: bool = True,
        cause: Optional[ControlOutcome] = None,
    ) -> None:
        if outcome is ControlOutcome.ROBOT_STUCK:
            message = self._robot.explained(message)  # before the stop, which a guard has nothing against
        if stop:
            self._send(STOP)
        pose, distance, angle = self._where()
        self.task.end(ending, FollowResult(outcome, message, pose, distance, angle, cause))

    def _where(self) -> Tuple[Optional[FramedPose], float, float]:
        return (None, math.inf, math.inf) if self._view is None else self._view[1:]


def _same_end(old: Path, new: Path) -> bool:
    """Return whether two paths lead to one goal."""
    return old.frame == new.frame and bool(np.allclose(old.poses[-1], new.poses[-1], rtol=0.0, atol=1e-3))
