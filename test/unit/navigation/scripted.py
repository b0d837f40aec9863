"""Scripted plugins, a robot of paper and a worker whose jobs end when the test says so."""

import math
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple

import numpy as np

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.grid import Grid
from mbf_relay.navigation.goals import FramedPose, NavigateGoal
from mbf_relay.navigation.robot import Robot
from mbf_relay.navigation.worker import Job, Worker
from mbf_relay.outcomes import ControlError, ControlOutcome, PlanningError, PlanOutcome, StaleDataError, TransformError
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Planner
from mbf_relay.recovery.recovery import Recovery

FORWARD = Twist2D(0.2, 0.0, 0.0)
GOAL = NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "map"))
NO_WAY = PlanningError(PlanOutcome.NO_PATH_FOUND, "walls all around")
STUCK = ControlError(ControlOutcome.NO_VALID_CMD, "all trajectories hit something")


def straight_path(length: float = 1.0, frame: str = "map", end_y: float = 0.0) -> Path:
    """A path along x."""
    xs = np.linspace(0.0, length, 11)
    return Path(np.column_stack((xs, np.full(11, end_y), np.zeros(11))), frame)


def line(start: Pose2D, goal: Pose2D) -> Path:
    """A path straight to the goal."""
    steps = np.linspace(0.0, 1.0, 11)[:, None]
    return Path(np.array([start]) * (1.0 - steps) + np.array([goal]) * steps, "map", 1.0)


class PaperRobot(Robot):
    """A robot that is where its commands took it, at once and exactly."""

    def __init__(self) -> None:
        super().__init__()
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.sent: List[Twist2D] = []
        self.frames = {"map", "odom", "base"}
        self.lost: Optional[str] = None
        self.stale: Optional[str] = None
        self.reported: Optional[Twist2D] = None
        self.held = False
        self.silence = self.objection = ""

    @property
    def unheard(self) -> str:
        return self.silence

    @property
    def held_back(self) -> str:
        return self.objection

    def pose_in(self, frame: str) -> Pose2D:
        if self.lost or frame not in self.frames:
            raise TransformError(self.lost or f"no transform from 'base' to '{frame}'")
        return self.pose

    def transform(self, target_frame: str, source_frame: str) -> Pose2D:
        if self.lost or not {target_frame, source_frame} <= self.frames:
            raise TransformError(self.lost or f"no transform from '{source_frame}' to '{target_frame}'")
        source, target = (self.pose if frame == "base" else IDENTITY for frame in (source_frame, target_frame))
        return source.relative_to(target)

    def velocity(self) -> Twist2D:
        if self.stale:
            raise StaleDataError(self.stale)
        if self.held:
            return STOP
        if self.reported is not None:
            return self.reported
        return self.sent[-1] if self.sent else STOP

    def command(self, velocity: Twist2D) -> None:
        assert velocity.is_finite()
        self.commanded = velocity
        self.sent.append(velocity)

    def move(self, seconds: float) -> None:
        """Let the last command act, unless something holds the robot."""
        if self.sent and not self.held:
            step = Pose2D(self.sent[-1].x * seconds, self.sent[-1].y * seconds, self.sent[-1].theta * seconds)
            self.pose = self.pose.compose(step)


class PaperCostmap:
    """An empty costmap as stale as the test says, its snapshots newer than any goal where it says nothing."""

    def __init__(self, frame: str) -> None:
        self.frame, self.robot_frame, self.parameters = frame, "base", CostmapParameters()
        self.stale: Optional[str] = None
        self.trouble: Optional[PlanningError] = None
        self.stamp = math.inf
        grid = Grid(0.05, -5.0, -5.0, 200, 200)
        self.costs = np.zeros(grid.shape, dtype=np.uint8)
        self.grid = grid
        self.footprint = np.zeros((0, 2))
        self.zone_limit = ZoneLimit()
        self.sees_all_round = False

    def snapshot(self) -> CostGrid:
        return CostGrid(self.grid, self.costs, self.frame, self.footprint, 0.1, 0.1, stamp=self.stamp)

    def stale_reason(self, now: float) -> Optional[str]:
        return self.stale

    def planning_trouble(self, now: float) -> Optional[PlanningError]:
        return self.trouble


class Script:
    """What plugins do, looked up at each call; a callable is called, an exception raised, anything else returned."""

    def __init__(self) -> None:
        self.plan: Any = line
        self.velocity: Any = FORWARD
        self.reached: Any = False
        self.recovery: Callable[[Any], Iterator[Twist2D]] = lambda context: iter(())
        self.calls: Dict[str, int] = {}
        self.planned_on: List[CostGrid] = []
        self.called_off: List[bool] = []
        self.paths: List[Any] = []
        self.cleaned_up = 0

    def run(self, name: str, *arguments: Any) -> Any:
        self.calls[name] = self.calls.get(name, 0) + 1
        what = getattr(self, name)
        if isinstance(what, BaseException):
            raise what
        return what(*arguments) if callable(what) else what


SCRIPT = Script()


def new_script() -> Script:
    """Start over; returns the script all scripted plugins follow from now on."""
    global SCRIPT
    SCRIPT = Script()
    return SCRIPT


class ScriptedPlanner(Planner):
    def plan(self, costmap, start, goal, tolerance, cancelled):
        SCRIPT.planned_on.append(costmap)
        SCRIPT.called_off.append(cancelled.is_cancelled())
        return SCRIPT.run("plan", start, goal)


class ScriptedController(Controller):
    def set_path(self, path, is_new_goal):
        SCRIPT.paths.append((path, is_new_goal))

    def compute_velocity(self, state: ControlState) -> Twist2D:
        return SCRIPT.run("velocity", *([state] if callable(SCRIPT.velocity) else []))

    def is_goal_reached(self, state, tolerance=None):
        return SCRIPT.run("reached", *([state] if callable(SCRIPT.reached) else []))


class ScriptedRecovery(Recovery):
    """What the script says; `LeavingRecovery` is the same, and drives the robot elsewhere."""

    def run(self, context):
        script = SCRIPT  # one that was left unfinished is closed while a later test goes by a script of its own
        script.calls[self.name] = script.calls.get(self.name, 0) + 1
        try:
            yield from script.run("recovery", context)
        finally:
            script.cleaned_up += 1


class LeavingRecovery(ScriptedRecovery):
    leaves_place = True


class LookingRecovery(ScriptedRecovery):
    only_looks_round = True


class HeldWorker(Worker):
    """Runs a job some steps after it was started, as a thread would at some later time.

    Attributes:
        delays: Steps each further job takes, in turn; None for one that hangs. One step each when used up.
    """

    def __init__(self) -> None:
        self.delays: List[Optional[int]] = []
        self._held: List[Tuple[Job, Optional[int]]] = []

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        job = Job(task)
        self._held.append((job, self.delays.pop(0) if self.delays else 1))
        return job

    def step(self) -> None:
        """Run what is due."""
        held, self._held = self._held, []
        for job, left in held:
            if left is not None and left <= 1:
                job.run()
            else:
                self._held.append((job, None if left is None else left - 1))

    def release(self) -> None:
        """Let everything that hangs return."""
        self._held = [(job, 1) for job, _left in self._held]
        self.step()


def config(**parameters: Any) -> Dict[str, Any]:
    """A server's parameters with two scripted plugins of each kind."""
    def entries(*names: str, kind: str) -> List[Dict[str, str]]:
        return [{"name": name, "type": f"{__name__}.Scripted{kind}"} for name in names]

    return {
        "planners": entries("P1", "P2", kind="Planner"),
        "controllers": entries("C1", "C2", kind="Controller"),
        "recovery_behaviors": entries("R1", "R2", kind="Recovery"),
        "robot_frame": "base", "controller_frequency": 10.0, "controller_patience": 1.0, "planner_patience": 1.0,
        "recovery_patience": 2.0, **parameters,
    }


def arrive(bench: Any, x: float = 0.95) -> None:
    """Let the controller say it has arrived once the robot is at `x` (m)."""
    bench.script.reached = lambda state: bench.robot.pose.x >= x


def bowed_path(height: float, length: float = 1.0) -> Path:
    """A path along x with a bow to one side."""
    xs = np.linspace(0.0, length, 11)
    return Path(np.column_stack((xs, height * np.sin(np.pi * xs / length), np.zeros(11))), "map")


def failing(error: Exception, times: int, otherwise: Any) -> Callable:
    """A script's entry that raises `times` times."""
    left = [times]

    def run(*arguments: Any) -> Any:
        if left[0] > 0:
            left[0] -= 1
            raise error
        return otherwise(*arguments) if callable(otherwise) else otherwise

    return run
