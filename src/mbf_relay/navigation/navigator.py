"""The navigator: the plugins and the four actions with their concurrency slots, stepped by one thread."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from typing import Any, Callable, Deque, Dict, List, Mapping, Optional, Tuple

from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.navigation.controller_execution import ControllerExecution
from mbf_relay.navigation.goals import (
    FollowGoal,
    FollowResult,
    FramedPose,
    NavigateGoal,
    NavigateResult,
    PlanGoal,
    PlanResult,
    RecoverGoal,
    RecoverResult,
)
from mbf_relay.navigation.move_base import MoveBase, RecoveryWatcher
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.planner_execution import PlannerExecution, PlanWatcher
from mbf_relay.navigation.plugin_lists import CONTROLLER_LIST, PLANNER_LIST, RECOVERY_LIST
from mbf_relay.navigation.recovery_execution import RecoveryExecution
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.robot import Robot
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.navigation.worker import InlineWorker, Worker
from mbf_relay.outcomes import ControlOutcome, PlanOutcome, RecoveryOutcome
from mbf_relay.plugins import PluginError
from mbf_relay.timing import Stopwatch

OWN_INSTANCE = "move_base"
"""Key of the plugin instances that move_base uses, so that get_path and recovery goals do not make it wait."""


class Navigator:
    """Carries out goals of the four actions; advanced by `update`.

    Each of `get_path`, `exe_path`, `recovery` and `move_base` takes a goal and returns its task, which may be done
    already. One goal runs per action and slot: a newer one replaces it. All methods must be called from one thread, the
    one that steps; only `Task.cancel` may be called from others.

    Args:
        config: The server's parameters as a mapping: `planners`, `controllers`, `recovery_behaviors`, each plugin's own
            group, and NavigatorParameters.
        robot: Gives poses and odometry, and takes velocities.
        costmaps: "global" and "local", live.
        worker: Runs the calls of plugins; None to run them inline.

    Attributes:
        odom_topic: Topic of odometry: the server's parameter if given, else the first one in a controller's parameters.
        plan_watcher: Called with each path found for a goal, and the planner's name; None for nobody.
        recovery_watcher: Called when a recovery of move_base begins; None for nobody.
        failure_watcher: Called with the text of a recovery of move_base that failed; None for nobody.

    Raises:
        PluginError, ValueError: A list, a plugin or a parameter is wrong; the text says which.
    """

    def __init__(
        self, config: Mapping[str, Any], robot: Robot, costmaps: Mapping[str, Any], worker: Optional[Worker] = None
    ) -> None:
        worker = worker or InlineWorker()
        values = dict(config)
        values.setdefault("global_frame", config.get("map_frame", "map"))
        self.parameters, _notes = NavigatorParameters.read(values)  # the node logs the notes
        self.robot, self.costmaps = robot, costmaps
        self.planners = PLANNER_LIST.registry(config, worker)
        self.controllers = CONTROLLER_LIST.registry(config, worker)
        self.recoveries = RECOVERY_LIST.registry(config, worker)
        made = [self.controllers.plugin(name) for name in self.controllers.names]
        robot.steering = next((controller.steering for controller in made if controller.steering), None)
        named = next((controller.odom_topic for controller in made if controller.odom_topic), "")
        self.odom_topic = self.parameters.odom_topic if "odom_topic" in config or not named else named
        self._plans: Dict[int, PlannerExecution] = {}
        self._drives: Dict[int, ControllerExecution] = {}
        self._recovery_runs: Dict[int, RecoveryExecution] = {}
        self._move_base: Optional[MoveBase] = None
        self._announced: Deque[Tuple[str, FramedPose]] = deque(maxlen=100)  # bounded: in lockstep nobody takes them
        self.plan_watcher: Optional[PlanWatcher] = None
        self.recovery_watcher: Optional[RecoveryWatcher] = None
        self.failure_watcher: Optional[Callable[[str], None]] = None

    # the actions

    def get_path(self, goal: PlanGoal) -> Task[PlanResult]:
        """Find a path."""
        execution = self.new_plan(goal, instance=goal.slot)
        running = self._plans.get(goal.slot)
        if execution.task.done:
            return execution.task
        if running is not None and not running.task.done:
            running.give_up(Ending.CANCELED, PlanOutcome.CANCELED, "Goal preempted by a new goal")
        self._plans[goal.slot] = execution
        return execution.task

    def exe_path(self, goal: FollowGoal, owner: Optional[Task[Any]] = None) -> Task[FollowResult]:
        """Drive along a path; a running drive of the same controller and slot changes over without a stop.

        Args:
            goal: The path and how to drive it.
            owner: The task it is a part of, if any: cancelling that cancels the drive, and it checks for oscillation.
        """
        task: Task[FollowResult] = Task(owner)
        try:
            instance = self.controllers.instance(self.controllers.choose(goal.controller), goal.slot)
            if len(goal.path) == 0:
                raise ValueError("Controller started with an empty plan!")
        except PluginError as error:
            task.end(Ending.REJECTED, FollowResult(ControlOutcome.INVALID_PLUGIN, str(error)))
            return task
        except ValueError as error:
            task.end(Ending.ABORTED, FollowResult(ControlOutcome.INVALID_PATH, str(error)))
            return task
        running = self._drives.get(goal.slot)
        if running is not None and not running.task.done and running.instance is not instance:
            running.replaced()
        if running is None or running.task.done:
            running = ControllerExecution(
                instance, self.robot, self.costmaps[instance.costmap], lambda: self.parameters,
                zone_limit=self._zone_limit,
            )
            self._drives[goal.slot] = running
        running.watch_oscillation = owner is None
        running.follow(goal, task)
        self._announced.append(("controller", FramedPose(goal.path.goal, goal.path.frame)))
        return task

    def recovery(self, goal: RecoverGoal) -> Task[RecoverResult]:
        """Run a recovery behaviour."""
        execution = self.new_recovery(goal, instance=goal.slot)
        if execution.task.done:
            return execution.task
        running = self._recovery_runs.get(goal.slot)
        if running is not None and not running.task.done:
            running.replaced()
        self._recovery_runs[goal.slot] = execution
        return execution.task

    def move_base(self, goal: NavigateGoal) -> Task[NavigateResult]:
        """Go somewhere; a running goal ends as replaced, its drive goes on until there is a path to the new one."""
        task: Task[NavigateResult] = Task()
        unknown = self._unknown_plugin(goal)
        if unknown is not None:
            task.end(Ending.REJECTED, unknown)
            return task
        running, driving = self._move_base, None
        if running is not None and not running.task.done:
            driving = running.driving
            running.replaced()
        self._move_base = MoveBase(goal, self, task, driving)
        return task

    def _zone_limit(self) -> ZoneLimit:
        """Return the lower of the two costmaps' speed limits at the robot's place."""
        return ZoneLimit.lowest(costmap.zone_limit for costmap in self.costmaps.values())

    def _unknown_plugin(self, goal: NavigateGoal) -> Optional[NavigateResult]:
        wanted: List[Tuple[Registry[Any], str, Enum]] = [
            (self.planners, goal.planner, PlanOutcome.INVALID_PLUGIN),
            (self.controllers, goal.controller, ControlOutcome.INVALID_PLUGIN),
        ]
        wanted += [(self.recoveries, name, RecoveryOutcome.INVALID_PLUGIN) for name in goal.recovery_behaviors]
        for registry, name, outcome in wanted:
            try:
                registry.choose(name)
            except PluginError as error:
                return NavigateResult(outcome, str(error))
        return None

    # stepping

    def update(self, now: float) -> None:
        """Advance everything to `now` (s)."""
        for execution in list(self._plans.values()) + list(self._recovery_runs.values()):
            execution.update(now)
        for drive in list(self._drives.values()):
            drive.update(now)
        if self._move_base is not None:
            self._move_base.update(now)
            self.update_drive(now)  # start a drive that move_base has just begun at once
        self._drop_finished()

    def update_drive(self, now: float) -> None:
        """Advance the drive of slot 0 only."""
        if 0 in self._drives:
            self._drives[0].update(now)

    @property
    def due(self) -> float:
        """Time (s) at which the next update is needed, beside the end of a plugin's call; infinite when idle."""
        return min((part.due for part in self._running()), default=math.inf)

    @property
    def idle(self) -> bool:
        """Return whether no goal runs."""
        return not self._running()

    def drop_all(self) -> None:
        """Drop all goals without ending their tasks; the caller has to end them, as after an internal error."""
        self._plans, self._drives, self._recovery_runs, self._move_base = {}, {}, {}, None

    def take_announced(self) -> List[Tuple[str, FramedPose]]:
        """Return the goals since the last call: ("planner", target) or ("controller", end of the path)."""
        announced = list(self._announced)
        self._announced.clear()
        return announced

    def _running(self) -> List[Any]:
        """Return all executions, and the MoveBase if there is one."""
        parts: List[Any] = [*self._plans.values(), *self._drives.values(), *self._recovery_runs.values()]
        return parts if self._move_base is None else [*parts, self._move_base]

    def _drop_finished(self) -> None:
        for slots in (self._plans, self._drives, self._recovery_runs):
            for slot in [slot for slot, part in slots.items() if part.task.done]:
                del slots[slot]
        if self._move_base is not None and self._move_base.task.done:
            self._move_base = None

    # parameters

    def reconfigure(self, parameters: NavigatorParameters) -> None:
        """Use other parameters from the next cycle on."""
        self.parameters = parameters

    # parts that have no slot

    def new_plan(
        self, goal: PlanGoal, retry: bool = True, instance: Any = OWN_INSTANCE, announced: bool = True,
        pathless: Optional[Stopwatch] = None,
    ) -> PlannerExecution:
        """Return an execution of `goal`; its task is done already where there is no such planner.

        Args:
            goal: What to plan.
            retry: Whether to retry failed plans until patience ends.
            instance: Key of the planner's instance: a slot, OWN_INSTANCE or a service's own.
            announced: Whether to publish the goal and the path; not for make_plan, which is no goal.
            pathless: Stopwatch that runs while there is no path; its time counts as patience used.
        """
        task: Task[PlanResult] = Task()
        planner = None
        try:
            planner = self.planners.instance(self.planners.choose(goal.planner), instance)
        except PluginError as error:
            task.end(Ending.REJECTED, PlanResult(PlanOutcome.INVALID_PLUGIN, str(error)))
        costmap = self.costmaps[planner.costmap] if planner is not None else None
        if announced:
            self._announced.append(("planner", goal.target))
        return PlannerExecution(
            goal,
            planner,
            self.robot,
            costmap,
            lambda: self.parameters,
            task,
            retry,
            self.plan_watcher if announced else None,
            pathless,
        )

    def new_recovery(self, goal: RecoverGoal, controller: str = "", instance: Any = OWN_INSTANCE) -> RecoveryExecution:
        """Return an execution of `goal`; its task is done already where there is no such behaviour."""
        task: Task[RecoverResult] = Task()
        behavior = None
        try:
            behavior = self.recoveries.instance(self.recoveries.choose(goal.behavior), instance)
        except PluginError as error:
            task.end(Ending.REJECTED, RecoverResult(RecoveryOutcome.INVALID_PLUGIN, str(error), goal.behavior))
        try:
            failed = self.controllers.plugin(self.controllers.choose(controller))
        except PluginError:
            failed = None
        return RecoveryExecution(
            goal, behavior, self.robot, self.costmaps, failed, lambda: self.parameters, task, self._zone_limit)
