"""Execution of recovery: a behaviour's velocities, patience, cancelling, and a zero velocity at its end."""

from __future__ import annotations

import math
from typing import Any, Callable, Iterator, Mapping, Optional

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import SpeedLimit
from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.cycle_load import CyclePeriod
from mbf_relay.navigation.goals import RecoverGoal, RecoverResult
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.progress import IgnoredCommands
from mbf_relay.navigation.registry import PluginInstance
from mbf_relay.navigation.robot import OVERRUN_PERIODS, TOO_OLD, Robot
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.worker import Job
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome, StaleDataError, TransformError
from mbf_relay.recovery.recovery import Recovery, RecoveryContext
from mbf_relay.timing import Pacer, Stopwatch


class RecoverySurroundings(RecoveryContext):
    """RecoveryContext of a behaviour's present step. With delayed commands, pose and velocity are predicted."""

    def __init__(self, robot: Robot, costmaps: Mapping[str, Any], controller: Optional[Controller]) -> None:
        self._robot, self._costmaps, self._controller = robot, costmaps, controller
        self.time, self.step_period = 0.0, 0.0

    @property
    def now(self) -> float:
        """Time (s)."""
        return self.time

    @property
    def period(self) -> float:
        """Time (s) between two steps."""
        return self.step_period

    @property
    def velocity(self) -> Twist2D:
        """The robot's velocity in the body frame: the last command if commands are delayed, else from odometry.

        Raises:
            StaleDataError: Odometry is missing or too old.
        """
        measured, commanded = self._robot.velocity(), self._robot.commanded
        return measured if commanded is None or self._robot.delay.seconds == 0.0 else commanded

    def pose_in(self, frame: str) -> Pose2D:
        """Return the robot's pose in `frame`; raise TransformError where it is unknown or too old."""
        pose = self._robot.pose_in(frame)
        costmap = next((costmap for costmap in self._costmaps.values() if costmap.frame == frame), None)
        if costmap is None:
            return pose
        here = self._robot.caught_up(pose, frame)
        if self._robot.delay.seconds == 0.0:  # avoid taking a snapshot
            return here
        return self._robot.expected_in(here, costmap.snapshot())

    @property
    def costmaps(self) -> Mapping[str, Any]:
        """The live costmaps, "local" and "global"."""
        return self._costmaps

    @property
    def controller(self) -> Optional[Controller]:
        """The controller that failed, or None."""
        return self._controller


class RecoveryExecution:
    """Runs one behaviour; advanced by `update` until its task is done.

    Behaviour as mbf_abstract_nav's AbstractRecoveryExecution and RecoveryAction: a behaviour that gives up ends its
    goal SUCCEEDED with its own outcome, as in Move Base Flex. Cancelling takes effect between two steps. The robot is
    stopped while a step takes too long, and the behaviour is given up after recovery_patience.

    Args:
        goal: Name of the behaviour.
        instance: The behaviour; None only if the task is done already.
        robot: Gives poses and odometry, and takes velocities.
        costmaps: The live costmaps, "local" and "global".
        controller: The controller that failed, or None.
        parameters: Returns the present parameters.
        task: Ends with the result.
        zone_limit: Returns the speed limit at the robot's place.
    """

    def __init__(
        self,
        goal: RecoverGoal,
        instance: Optional[PluginInstance[Recovery]],
        robot: Robot,
        costmaps: Mapping[str, Any],
        controller: Any,
        parameters: Callable[[], NavigatorParameters],
        task: Task[RecoverResult],
        zone_limit: Callable[[], ZoneLimit] = ZoneLimit,
    ) -> None:
        self.goal, self.task = goal, task
        self._instance = instance
        self._robot, self._costmaps, self._parameters = robot, costmaps, parameters
        self._zone_limit = zone_limit
        self._context = RecoverySurroundings(robot, costmaps, controller)
        self._steps: Optional[Iterator[Twist2D]] = None
        self._job: Optional[Job] = None
        self._given_up = False
        self._moved = False
        self._command, self._ignored = STOP, IgnoredCommands()
        self._pacer, self._since_start, self._since_call = Pacer(), Stopwatch(), Stopwatch()
        self._cycle_period = CyclePeriod()

    @property
    def instance(self) -> PluginInstance[Recovery]:
        """The behaviour."""
        assert self._instance is not None
        return self._instance

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a job."""
        return math.inf if self.task.done else self._pacer.next

    def update(self, now: float) -> None:
        """Send the velocity of the last step, if it is ready, and begin the next step when it is due."""
        if self.task.done:
            return
        if not self._since_start.running:
            self._since_start.start(now)
        if self.task.cancel_requested:
            self._give_up(
                Ending.CANCELED, RecoveryOutcome.CANCELED, f"Recovery behaviour \"{self.instance.name}\" canceled!"
            )
            return
        if self._robot.paused:
            self._since_start.start(now)
            self._since_call.start(-math.inf)  # so that a velocity computed before the pause is dropped
            if self._pacer.is_due(now):
                self._pacer.passed(now, 1.0 / self._parameters().controller_frequency)
            if self._moved and self._robot.commanded != STOP:
                self._send(STOP)
            return
        if self._job is not None:
            self._watch(now, self._job)
        if not self.task.done:
            self._watch_patience(now)
        if not self.task.done and self._pacer.is_due(now):
            self._pacer.passed(now, 1.0 / self._parameters().controller_frequency)
            if self._job is None:
                self._begin(now)

    def replaced(self) -> None:
        """End because another goal takes over."""
        self._give_up(Ending.CANCELED, RecoveryOutcome.CANCELED, "Recovery preempted by a new goal")

    def _begin(self, now: float) -> None:
        if self.instance.busy:
            return
        if self._moved and self._blind(now):
            self._send(STOP)
            return
        try:
            self._robot.note_motion(now, self._robot.velocity())
        except StaleDataError:
            pass  # a behaviour that does not move the robot needs no odometry
        self._since_call.start(now)
        self._context.time = now
        self._context.step_period = self._cycle_period.note(now, 1.0 / self._parameters().controller_frequency)
        self._job = self.instance.call(self._step)
        if self._job.done:
            self._collect(now)

    def _step(self, behavior: Recovery) -> Optional[Twist2D]:
        """Run the behaviour to its next velocity, None at its end; on the worker."""
        if self._steps is None:
            self._steps = iter(behavior.run(self._context))
        done: Any = object()
        velocity = next(self._steps, done)
        if self._given_up:
            self._close(behavior)
        if velocity is None:
            raise ValueError("it yielded None; it must yield a Twist2D at each step, and return when it is done")
        return None if velocity is done else velocity

    def _close(self, _behavior: Recovery) -> None:
        close = getattr(self._steps, "close", None)
        if close is not None:
            close()

    def _watch(self, now: float, job: Job) -> None:
        """Collect the running step if it is done; else stop the robot when it takes too long."""
        if job.done:
            self._collect(now)
        elif self._command != STOP:
            if self._since_call.elapsed(now) > OVERRUN_PERIODS / self._parameters().controller_frequency:
                self._send(STOP)

    def _collect(self, now: float) -> None:
        job, self._job = self._job, None
        assert job is not None
        name = self.instance.name
        try:
            velocity = job.result()
            velocity = velocity if velocity is None else Twist2D.of(velocity)
            if velocity is not None and not velocity.is_a_robots():
                raise ValueError(f"it wanted velocity {tuple(velocity)}, which no robot drives")
        except RecoveryError as error:
            self._finish(Ending.SUCCEEDED, error.outcome, error.message)
        except TransformError as error:
            self._finish(Ending.SUCCEEDED, RecoveryOutcome.TF_ERROR, str(error))
        except StaleDataError as error:
            self._finish(Ending.SUCCEEDED, RecoveryOutcome.FAILURE, str(error))
        except Exception as error:  # a plugin may raise anything; that ends the goal, not the server
            message = f"recovery behaviour '{name}' failed with {self.instance.failure_text(error)}"
            self._give_up(Ending.ABORTED, RecoveryOutcome.INTERNAL_ERROR, message)
        else:
            if velocity is None:
                self._finish(Ending.SUCCEEDED, RecoveryOutcome.SUCCESS, f'Recovery "{name}" done')
            else:
                self._drive(now, velocity)

    def _drive(self, now: float, velocity: Twist2D) -> None:
        if self.task.cancel_requested:
            return
        if velocity != STOP and (self._since_call.elapsed(now) > TOO_OLD or self._blind(now)):
            velocity = STOP
        self._moved = self._moved or velocity != STOP
        velocity = self._at_the_zone_s_pace(velocity)
        self._send(velocity)
        self._watch_wheels(now, velocity)

    def _watch_wheels(self, now: float, velocity: Twist2D) -> None:
        """Give up a behaviour whose commands do not move the robot (cmd_vel_ignored_tolerance), as a drive is.
        """
        tolerance = self._parameters().cmd_vel_ignored_tolerance
        try:
            measured, pose = self._robot.velocity(), self._robot.pose_in(self._costmaps["local"].frame)
        except (StaleDataError, TransformError):  # _begin stops it at its next step
            return
        if 0.0 < tolerance < self._ignored.ignored_for(now, velocity, measured, pose):
            message = f"Recovery behaviour '{self.instance.name}': {self._ignored.told(now, velocity)}"
            self._give_up(Ending.ABORTED, RecoveryOutcome.PAT_EXCEEDED, message)

    def _at_the_zone_s_pace(self, velocity: Twist2D) -> Twist2D:
        """Return the velocity, scaled down along the same arc to the speed limit of the zone."""
        zone, controller = self._zone_limit(), self._context.controller
        top_speeds = (math.inf, math.inf) if controller is None else controller.top_speeds
        return SpeedLimit(zone.speed, share=zone.share).slowed(velocity, *top_speeds)

    def _send(self, velocity: Twist2D) -> None:
        if velocity == STOP:
            self._ignored = IgnoredCommands()  # begin anew: a robot that stands as commanded ignores nothing
        self._command = velocity
        self._robot.command(velocity)

    def _blind(self, now: float) -> bool:
        """Return whether the local costmap, the robot's pose or odometry is too old to move."""
        costmap = self._costmaps["local"]
        try:
            self._robot.pose_in(costmap.frame)
        except TransformError:
            return True
        return not self._robot.knows_its_motion or bool(costmap.stale_reason(now))

    def _watch_patience(self, now: float) -> None:
        patience = self._parameters().recovery_patience
        if patience > 0.0 and self._since_start.elapsed(now) > patience:
            message = f"Recovery behaviour '{self.instance.name}' exceeded its patience of {patience:g} s"
            self._give_up(Ending.ABORTED, RecoveryOutcome.PAT_EXCEEDED, message)

    def _give_up(self, ending: Ending, outcome: RecoveryOutcome, message: str) -> None:
        """End an unfinished behaviour and close its generator, now or when its running step returns."""
        self._given_up = True
        if self._steps is not None and not self.instance.busy:
            self.instance.call(self._close)
        self._finish(ending, outcome, message)

    def _finish(self, ending: Ending, outcome: RecoveryOutcome, message: str) -> None:
        self._robot.command(STOP)
        self.task.end(ending, RecoverResult(outcome, message, self.instance.name))
