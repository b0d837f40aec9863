"""What every controller that follows a path does the same way: keep its place, turn, brake for the goal, and give up."""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import Any, Callable, ClassVar, Optional, Type

import numpy as np

from mbf_relay.control.back_out import BackOut
from mbf_relay.control.controller import Controller, ControlState, GoalTolerance
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.goal_keeper import GoalKeeper
from mbf_relay.control.guards import GoalGuard, StuckGuard
from mbf_relay.control.local_path import LocalPath, PathTracker
from mbf_relay.control.obstacle_view import ObstacleView
from mbf_relay.control.report import CycleReport
from mbf_relay.control.trajectories import VelocityWindow, speed_to_stop_within, window_of
from mbf_relay.control.turning import free_turn, free_way_round, turn_rate
from mbf_relay.geometry import STOP, Pose2D, Twist2D, angle_between
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.parameters import ParameterSet
from mbf_relay.planning.path import Path

TURNED = 0.15  # rad: a turn towards the path ends here
NARROW, WIDE = 0.02, 0.15  # m between the sides of the footprint and obstacles: where focus is least, and where it is 1
NARROWEST_FOCUS = 0.4
BEHIND = 0.7  # m of path kept behind the robot


@dataclass(frozen=True)
class Surroundings:
    """What one cycle works on.

    Attributes:
        state: As handed in.
        path: The path round the robot.
        view: The obstacles.
        velocity: The velocity the robot is at: the last command where it followed that, else as measured.
        window: The velocities in reach, within the top speeds for now.
        speed: Top translational speed (m/s) for now.
        turn: Top rotational speed (rad/s) for now.
        focus: 1 in the open, less where the path ahead is narrow: by how much to shorten what the robot looks ahead.
    """

    state: ControlState
    path: LocalPath
    view: ObstacleView
    velocity: Twist2D
    window: VelocityWindow
    speed: float
    turn: float
    focus: float = 1.0


class PathFollower(Controller, abc.ABC):
    """A controller that turns to the path, follows it by `drive`, stops at the goal and turns to its heading.

    Attributes:
        command: The velocity of the last cycle.
        watcher: Called with a CycleReport after each cycle, in the controller's thread; None for nobody.
    """

    Parameters: ClassVar[Type[ParameterSet]] = FollowerParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._tracker = PathTracker()
        self._goal_keeper = GoalKeeper()
        self._stuck_guard = StuckGuard()
        self._goal_guard = GoalGuard()
        self._back_out = BackOut()
        self.command = STOP
        self.watcher: Optional[Callable[[CycleReport], None]] = None
        self._around: Optional[Surroundings] = None
        self._drove = False
        self._commanded_at: Optional[float] = None
        self._started_from = STOP
        self._turn_left: Optional[float] = None

    @abc.abstractmethod
    def drive(self, around: Surroundings) -> Twist2D:
        """Return the velocity that follows the path, within `around.window`.

        Raises:
            ControlError: Nothing is left to drive.
        """

    @property
    @abc.abstractmethod
    def lookahead(self) -> float:
        """Distance (m) ahead on the path whose direction the robot faces before it drives."""

    @property
    @abc.abstractmethod
    def turn_to_path_angle(self) -> float:
        """Heading error (rad) beyond which the robot turns on the spot before it drives."""

    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path`; see Controller."""
        self._tracker.set_path(path)
        if is_new_goal:
            self._goal_keeper.reset()
            self._goal_guard.reset()
            self._stuck_guard.reset()
            self._back_out.reset()
            self._turn_left = None

    def is_goal_reached(self, state: ControlState, tolerance: Optional[GoalTolerance] = None) -> bool:
        """Tell whether the robot stands at the goal; see Controller."""
        if self._tracker.path is None:
            return False
        self._goal_keeper.tolerance = tolerance
        goal = state.costmap_from_path.compose(self._tracker.path.goal)
        return self._goal_keeper.is_reached(state, goal, self.parameters)

    def compute_velocity(self, state: ControlState) -> Twist2D:
        """Return the velocity to command; see Controller."""
        self._around, self._drove = None, False
        try:
            command = self._decide(state)
        except ControlError:
            self._remember(state, STOP)
            self._stuck_guard.reset()
            raise
        else:
            self._remember(state, command)
            return command
        finally:
            if self.watcher is not None and self._around is not None:
                self.watcher(self.report(self._around, self._drove))

    def report(self, around: Surroundings, drove: bool) -> CycleReport:
        """Return what to show of a cycle; `drove` tells whether `drive` was asked in it."""
        return CycleReport(around.state.now, around.state.costmap, around.path, np.zeros((0, 3)))

    def _decide(self, state: ControlState) -> Twist2D:
        parameters = self.parameters
        if self._tracker.path is None:
            raise ControlError(ControlOutcome.NOT_INITIALIZED, "there is no path to follow; set one first")
        if not (state.pose.is_finite() and state.velocity.is_finite()):
            raise ControlError(
                ControlOutcome.INTERNAL_ERROR, f"pose {tuple(state.pose)} or velocity {tuple(state.velocity)} is not finite"
            )
        around = self._around = self.look_around(state)
        self._stuck_guard.check(state, self.command, parameters.stuck_timeout)
        self._goal_guard.check(state, around.path, around.view, parameters)
        if self._goal_keeper.is_turning(state.pose, around.path.goal, parameters):
            self._turn_left = None
            return self._turn_at_goal(around)
        if around.path.robot_distance > parameters.missed_path_distance:
            raise ControlError(
                ControlOutcome.MISSED_PATH,
                f"the robot is {around.path.robot_distance:.2f} m from the path; at most "
                f"{parameters.missed_path_distance:.2f} m (missed_path_distance) can be rejoined",
            )
        turn = None if self._back_out.is_active else self.turn_to_path(around, self.turn_to_path_angle)
        if turn is not None:
            return turn
        self._drove = True
        return self._drive_or_back_out(around)

    def _drive_or_back_out(self, around: Surroundings) -> Twist2D:
        state, parameters = around.state, self.parameters
        back_out = self._back_out
        if not back_out.is_active:
            try:
                command = self.drive(around)
            except ControlError:
                back_out.failed(state.now, state.pose, around.path, around.view, parameters)
                if not back_out.is_active:
                    raise
            else:
                back_out.drove(around.path)
                return command
        backward = back_out.command(state.pose, around.velocity, around.view, parameters, state.period)
        return self.drive(around) if backward is None else backward

    def look_around(self, state: ControlState) -> Surroundings:
        """Return what this cycle works on: path, obstacles, and the velocities in reach and in order here."""
        parameters = self.parameters
        limit = self.speed_limit_at(state.pose)
        reach = max(parameters.max_vel_trans * getattr(parameters, "sim_time", 1.5), self.lookahead) + 1.0
        path = self._tracker.cut(state, BEHIND, reach, self.lookahead + 0.5)
        view = ObstacleView(state.costmap, parameters.obstacle_overlap)
        velocity = self._velocity_now(state, parameters)
        speed = min(parameters.max_vel_trans, limit.translation)
        delay = state.period + parameters.stop_time_buffer
        left = max(path.remaining, state.pose.distance_to(path.goal))
        speed = min(speed, speed_to_stop_within(left, 0.5 * parameters.acc_lim_x, state.period))
        speed = min(speed, self._speed_in_sight(path, view, state.pose, parameters.acc_lim_x, delay))
        turn = min(parameters.max_vel_theta, limit.rotation)
        window = window_of(parameters, velocity, state.period, speed, turn)
        focus = self._focus(path, view)
        return Surroundings(state, path, view, velocity, window, speed, turn, focus)

    def _focus(self, path: LocalPath, view: ObstacleView) -> float:
        """Return how narrow the path is from here to the end of what is looked ahead: 1 wide, NARROWEST_FOCUS narrow."""
        ahead = (path.arcs >= path.robot_arc - 0.1) & (path.arcs <= min(path.robot_arc + self.lookahead, path.goal_arc))
        room = view.room_along(path.points[ahead][::2])
        return min(1.0, max(NARROWEST_FOCUS, (room - NARROW) / (WIDE - NARROW)))

    @staticmethod
    def _speed_in_sight(path: LocalPath, view: ObstacleView, pose: Pose2D, acceleration: float, delay: float) -> float:
        """Return the speed from which the robot stops within the part of the path it sees from where it is."""
        ahead = path.arcs >= path.robot_arc
        points, arcs = path.points[ahead][::3], path.arcs[ahead][::3]
        hidden = np.flatnonzero(~view.in_sight(pose, points))
        if len(hidden) == 0:
            return math.inf
        return speed_to_stop_within(float(arcs[hidden[0]] - path.robot_arc), acceleration, delay)

    def _velocity_now(self, state: ControlState, parameters: FollowerParameters) -> Twist2D:
        """Return the last command where the robot is on its way to it, component by component, else what was measured.

        Odometry lags; a window built on it alone makes every acceleration come late and every stop overshoot.
        """
        elapsed = math.inf if self._commanded_at is None else state.now - self._commanded_at
        if not 0.0 <= elapsed <= 3.0 * state.period:
            return state.velocity
        last = self.command if state.commanded is None else state.commanded
        if elapsed < 0.5 * state.period and last == self.command:  # asked again before it could take effect
            return self._started_from
        limits = (parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta)
        values = [
            commanded if abs(commanded - measured) <= 2.0 * limit * state.period else measured
            for commanded, measured, limit in zip(last, state.velocity, limits)
        ]
        return Twist2D(*values)

    def _remember(self, state: ControlState, command: Twist2D) -> None:
        self._started_from = self._around.velocity if self._around is not None else state.velocity
        self.command, self._commanded_at = command, state.now

    def _turn_at_goal(self, around: Surroundings) -> Twist2D:
        """Brake, and turn to the goal's heading the way that is free."""
        state, p = around.state, self.parameters
        error = angle_between(state.pose.theta, around.path.goal.theta)
        still = around.window.clip(STOP)
        if abs(error) <= 0.5 * self._goal_keeper.tolerance_of(p).angle:
            return still
        way = free_way_round(around.view, state.pose, error)
        if way is None:
            if abs(error) <= self._goal_keeper.tolerance_of(p).angle:
                return still
            raise ControlError(
                ControlOutcome.BLOCKED_GOAL,
                f"the robot is at the goal's position and cannot turn by {math.degrees(error):.0f} degrees to its heading: "
                "an obstacle is in the way on both sides",
            )
        rate = turn_rate(way, around.velocity.theta, p, state.period, around.turn)
        return Twist2D(still.x, still.y, rate)

    def turn_to_path(self, around: Surroundings, least: float) -> Optional[Twist2D]:
        """Return a turn on the spot towards the path, None where there is no need or no room for one.

        A turn once begun goes on, in its direction, until the robot faces the path.

        Args:
            around: The cycle.
            least: Heading error (rad) that begins a turn.
        """
        state = around.state
        ahead = around.path.robot_arc + around.focus * self.lookahead
        target = around.path.point_at(min(ahead, around.path.goal_arc))
        dx, dy = target[0] - state.pose.x, target[1] - state.pose.y
        error = angle_between(state.pose.theta, math.atan2(dy, dx)) if math.hypot(dx, dy) >= 0.02 else 0.0
        begun, self._turn_left = self._turn_left, None
        if abs(error) < (TURNED if begun is not None else max(least, TURNED)):
            return None
        if begun is not None and abs(error) > math.pi / 2.0 and error * begun < 0.0:
            error -= math.copysign(2.0 * math.pi, error)
        way: Optional[float] = error
        if free_turn(around.view, state.pose, error) < abs(error) - 1e-9:
            way = free_way_round(around.view, state.pose, angle_between(0.0, error))
        if way is None:
            return None
        self._turn_left = way
        still = around.window.clip(STOP)
        return Twist2D(
            still.x, still.y, turn_rate(way, around.velocity.theta, self.parameters, state.period, around.turn))

    @staticmethod
    def nothing_left(around: Surroundings, reason: str) -> ControlError:
        """Return the error for a cycle in which nothing can be driven: COLLISION, BLOCKED_PATH or NO_VALID_CMD."""
        pose: Pose2D = around.state.pose
        if around.view.contacts_at(pose):
            return ControlError(
                ControlOutcome.COLLISION,
                f"the footprint at ({pose.x:.2f}, {pose.y:.2f}) lies on an obstacle and no velocity leads away from it: {reason}",
            )
        arc = around.path.first_blocked(around.view)
        if arc is not None:
            return ControlError(
                ControlOutcome.BLOCKED_PATH,
                f"an obstacle stands on the path {arc - around.path.robot_arc:.2f} m ahead: {reason}",
            )
        return ControlError(ControlOutcome.NO_VALID_CMD, f"no velocity is left to drive: {reason}")
