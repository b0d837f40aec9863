"""What all controllers that follow a path share: progress along it, turns, braking for the goal, and giving up."""

from __future__ import annotations

import abc
import math
from typing import Any, ClassVar, Optional, Tuple, Type

import numpy as np

from mbf_relay.control.back_out import ASKEW, BackOut, direction_of
from mbf_relay.control.braking import braked_on_its_arc, brakes_free, where_it_sees
from mbf_relay.control.checkers import FACING, BlockedGoalChecker, GoalChecker, StuckChecker
from mbf_relay.control.controller import Controller
from mbf_relay.control.cycle import ControlCycle
from mbf_relay.control.evasion import Evasion
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.local_path import LocalPath, PathTracker
from mbf_relay.control.report import CycleReport
from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.control.trajectories import commandable, speed_to_stop_within, window_of
from mbf_relay.control.turning import free_turn, free_way_round, turn_rate
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D, Twist2D, angle_between
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.parameters import ParameterSet
from mbf_relay.planning.path import Path

TURNED = 0.15  # heading error (rad) at which a turn to the path ends
LEAST_HORIZON_SCALE = 0.4  # horizon scale in passages of clearance NARROW, whose sides long arcs would touch
ROUND_GOAL = 2.0 * math.pi
"""Path left, in goal tolerances besides the robot's width, above which a robot within tolerance has not arrived: the
circumference round the goal. A path that passes near its goal and comes back to it later has more left."""

# in robot's widths
# clearance between footprint and obstacles at which the horizon scale is least, and from which it is 1
NARROW, WIDE = 0.1, 0.65
BEHIND = 3.0  # path cut out behind the robot
BEYOND = 4.5  # path cut out beyond the lookahead or horizon
EXTENSION = 2.0  # by which the path is extended beyond the goal, besides the lookahead
MISSED = 2.0  # distance from the path up to which it can always be rejoined
HERE = 0.1  # distance to a point below which its bearing is noise and not used
ODOMETRY_LAG = 0.1
"""Least time (s) of acceleration by which odometry may differ from a command that is being followed: three readings at
30 Hz. With two short cycles instead, a robot that accelerates slowly would never get going.
"""


class PathFollower(Controller, abc.ABC):
    """A controller that turns to the path, follows it with `drive`, stops at the goal and turns to its heading.

    Attributes:
        command: The velocity of the last cycle.
    """

    Parameters: ClassVar[Type[ParameterSet]] = FollowerParameters
    parameters: FollowerParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._tracker = PathTracker()
        self._goal_checker = GoalChecker()
        self._stuck_checker = StuckChecker()
        self._blocked_goal_checker = BlockedGoalChecker()
        self._back_out = BackOut()
        self.command = STOP
        self._cycle: Optional[ControlCycle] = None
        self._drove = False
        self._commanded_at: Optional[float] = None
        self._started_from = STOP
        self._turn_left: Optional[float] = None

    @abc.abstractmethod
    def drive(self, cycle: ControlCycle) -> Twist2D:
        """Return the velocity that follows the path, within `cycle.window`.

        Raises:
            ControlError: No velocity is possible; see `nothing_left`.
        """

    @property
    @abc.abstractmethod
    def lookahead(self) -> float:
        """Distance (m) ahead on the path to the point that the robot turns to before it drives.

        The robot's width is used where that is more.
        """

    @property
    @abc.abstractmethod
    def turn_to_path_angle(self) -> float:
        """Heading error (rad) beyond which the robot turns on the spot before it drives."""

    @property
    def turning_radius(self) -> float:
        """Minimum turning radius (m); 0 for a robot that turns on the spot."""
        return 0.0

    @property
    def horizon(self) -> float:
        """Longest prediction (s); the path is cut out as far ahead as the robot gets in that time."""
        return 1.5

    @property
    def top_speeds(self) -> Tuple[float, float]:
        """max_vel_trans and max_vel_theta."""
        return self.parameters.max_vel_trans, self.parameters.max_vel_theta

    @property
    def goal_tolerance(self) -> GoalTolerance:
        """xy_goal_tolerance and yaw_goal_tolerance."""
        return GoalTolerance(self.parameters.xy_goal_tolerance, self.parameters.yaw_goal_tolerance)

    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path`; see Controller."""
        self._tracker.set_path(path)
        if is_new_goal:
            self._goal_checker.reset()
            self._blocked_goal_checker.reset()
            self._stuck_checker.reset()
            self._back_out.reset()
            self._turn_left = None

    def is_goal_reached(self, state: ControlState, tolerance: Optional[GoalTolerance] = None) -> bool:
        """Return whether the robot stands at the goal; see Controller."""
        if self._tracker.path is None:
            return False
        self._goal_checker.tolerance = tolerance
        goal = state.costmap_from_path.compose(self._tracker.path.goal)
        return self._goal_checker.is_reached(state, goal, self.parameters) and self._ends_here(
            state, self._tracker.remaining(state))

    def _ends_here(self, state: ControlState, remaining: float) -> bool:
        """Return whether the path ends here, given the path left (m); see ROUND_GOAL."""
        tolerance = self._goal_checker.tolerance_of(self.parameters).distance
        return self._goal_checker.turns or (
            self._tracker.is_on_last_leg and remaining <= ROUND_GOAL * tolerance + state.costmap.width)

    def compute_velocity(self, state: ControlState) -> Twist2D:
        """Return the velocity to command; see Controller."""
        self._cycle, self._drove = None, False
        try:
            command = self._foreseen(state)
        except ControlError:
            self._remember(state, STOP)
            self._stuck_checker.reset()
            raise
        else:
            self._remember(state, command)
            return command
        finally:
            if self.watcher is not None and self._cycle is not None:
                self.watcher(self.report(self._cycle, self._drove))

    def report(self, cycle: ControlCycle, drove: bool) -> CycleReport:
        """Return what to show of a cycle; `drove` tells whether its command, or its error, came of `drive`."""
        return CycleReport(cycle.state.now, cycle.state.costmap, cycle.path, np.zeros((0, 3)))

    def _foreseen(self, state: ControlState) -> Twist2D:
        """Return the command of `_decide`, as changed by Evasion where a tracked obstacle comes near."""
        trouble: Optional[ControlError] = None
        try:
            command = self._decide(state)
        except ControlError as error:
            trouble, command = error, STOP
        cycle = self._cycle
        if cycle is not None and self.parameters.foresight:
            foresight = Foresight(state.costmap, state.pose, state.now + state.delay, self.parameters)
            if not foresight.is_blind:
                evasion = Evasion(self.parameters, foresight, state, self.speed_limit_at(state.pose),
                                  self.turning_radius, cycle.path)
                decided, command = command, evasion.command(cycle.velocity, command)
                if command != decided:
                    trouble = None
        if trouble is not None:
            raise trouble
        return command

    def _decide(self, state: ControlState) -> Twist2D:
        parameters = self.parameters
        if self._tracker.path is None:
            raise ControlError(ControlOutcome.NOT_INITIALIZED, "there is no path to follow; set one first")
        if not (state.pose.is_finite() and state.velocity.is_finite()):
            raise ControlError(
                ControlOutcome.INTERNAL_ERROR,
                f"pose {tuple(state.pose)} or velocity {tuple(state.velocity)} is not finite",
            )
        cycle = self._cycle = self.look_around(state)
        self._back_out.trail.note(state.pose, cycle.checker)
        told = self.command if state.told is None else state.told
        self._stuck_checker.check(state, told, parameters.stuck_timeout)
        tolerance = self._goal_checker.tolerance_of(parameters).distance
        is_occupied = self._tracker.is_on_last_leg and self._blocked_goal_checker.check(
            state, cycle.path, cycle.checker, parameters, tolerance)
        if self._ends_here(state, cycle.path.remaining) and self._goal_checker.update_turning(
                state, cycle.path.goal, parameters, is_occupied):
            self._turn_left = None
            return self._turn_at_goal(cycle)
        farthest = max(parameters.missed_path_distance, MISSED * state.costmap.width)
        if cycle.path.robot_distance > farthest and not self._back_out.is_active:
            raise ControlError(
                ControlOutcome.MISSED_PATH,
                f"the robot is {cycle.path.robot_distance:.2f} m from the path; at most {farthest:.2f} m "
                "(missed_path_distance) can be rejoined",
            )
        parameters.require_motion()
        turn = None if self._back_out.is_active else self.turn_to_path(cycle, self.turn_to_path_angle)
        if turn is not None:
            return turn
        self._drove = True
        return self._drive_or_back_out(cycle)

    def _drive_or_back_out(self, cycle: ControlCycle) -> Twist2D:
        state, parameters, back_out = cycle.state, self.parameters, self._back_out
        if not back_out.is_active:
            try:
                command = self.drive(cycle)
            except ControlError:
                back_out.failed(state.now, state.pose, cycle.path, cycle.checker, parameters, self.turning_radius)
                if not back_out.is_active:
                    command = braked_on_its_arc(parameters, cycle)
                    if command.speed() > 0.0 and command.theta != 0.0:
                        return command
                    raise
            else:
                back_out.drove(cycle.path, state.costmap.width)
                return where_it_sees(parameters, cycle, command)
        limit = self.speed_limit_at(state.pose)
        backward = back_out.command(state.pose, cycle.velocity, cycle.checker, parameters, state.period, limit)
        self._drove = backward is None
        return self.drive(cycle) if backward is None else backward

    def look_around(self, state: ControlState) -> ControlCycle:
        """Return the working data of this cycle: path, obstacles, dynamic window and speed limits."""
        parameters = self.parameters
        width = state.costmap.width
        lookahead = max(self.lookahead, width)
        reach = max(parameters.max_vel_trans * self.horizon, lookahead) + BEYOND * width
        path = self._tracker.cut(
            state, BEHIND * width, reach, lookahead + EXTENSION * width, parameters.xy_goal_tolerance)
        checker = FootprintChecker(state.costmap)
        velocity = self._velocity_now(state, parameters)
        speed, turn = self.speed_limit_at(state.pose).of(*self.top_speeds)
        delay = state.period + parameters.stop_time_buffer
        left = max(path.remaining, state.pose.distance_to(path.goal))
        speed = min(speed, speed_to_stop_within(left, 0.5 * parameters.acc_lim_x, state.period))
        speed = min(speed, self._speed_in_sight(path, checker, state.pose, parameters.acc_lim_x, delay))
        window = window_of(parameters, velocity, state.period, speed, turn)
        horizon_scale = self._horizon_scale(path, checker, lookahead)
        return ControlCycle(state, path, checker, velocity, window, speed, turn, lookahead, horizon_scale)

    @staticmethod
    def _horizon_scale(path: LocalPath, checker: FootprintChecker, lookahead: float) -> float:
        """Return the factor on distances looked ahead, by the least clearance of the path up to the lookahead.

        It is 1 from WIDE on and LEAST_HORIZON_SCALE at NARROW.
        """
        width = checker.costmap.width
        ahead = (path.arcs >= path.robot_arc - 0.5 * width) & (
            path.arcs <= min(path.robot_arc + lookahead, path.goal_arc)
        )
        clearance = checker.clearance_along(path.points[ahead][::2], WIDE * width) / width
        return min(1.0, max(LEAST_HORIZON_SCALE, (clearance - NARROW) / (WIDE - NARROW)))

    @staticmethod
    def _speed_in_sight(
        path: LocalPath, checker: FootprintChecker, pose: Pose2D, acceleration: float, delay: float
    ) -> float:
        """Return the speed (m/s) from which the robot can stop within the part of the path that is in sight."""
        ahead = path.arcs >= path.robot_arc
        points, arcs = path.points[ahead][::3], path.arcs[ahead][::3]
        hidden = np.flatnonzero(~checker.in_sight(pose, points))
        if len(hidden) == 0:
            return math.inf
        return speed_to_stop_within(float(arcs[hidden[0]] - path.robot_arc), acceleration, delay)

    def _velocity_now(self, state: ControlState, parameters: FollowerParameters) -> Twist2D:
        """Return the present velocity: by component, the last command where odometry agrees with it, else odometry.

        Odometry lags: with a window round it alone every acceleration comes late and every stop overshoots. A robot
        that moves faster than commanded counts as moving as commanded: else the slowest velocity in reach could be
        above the last command, and a robot that turns 1.4 times as fast as commanded would never stop turning.
        """
        if state.delay > 0.0 and state.commanded is not None:
            return commandable(parameters, state.commanded, state.commanded)
        elapsed = math.inf if self._commanded_at is None else state.now - self._commanded_at
        if not 0.0 <= elapsed <= 3.0 * state.period:
            return commandable(parameters, state.velocity, state.commanded or STOP)
        last = self.command if state.commanded is None else state.commanded
        measured_now = commandable(parameters, state.velocity, last)
        if elapsed < 0.5 * state.period and last == self.command:  # asked again before it could take effect
            return self._started_from
        limits = (parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta)
        late = max(2.0 * state.period, ODOMETRY_LAG)
        values = [
            commanded if abs(commanded - measured) <= limit * late or commanded * measured > commanded * commanded
            else measured
            for commanded, measured, limit in zip(last, measured_now, limits)
        ]
        return Twist2D(*values)

    def _remember(self, state: ControlState, command: Twist2D) -> None:
        self._started_from = self._cycle.velocity if self._cycle is not None else state.velocity
        self.command, self._commanded_at = command, state.now

    def _turn_at_goal(self, cycle: ControlCycle) -> Twist2D:
        """Return the command that brakes and turns to the goal's heading, in the direction that is free."""
        state, p = cycle.state, self.parameters
        error = angle_between(state.pose.theta, cycle.path.goal.theta)
        still = cycle.window.still
        if abs(error) <= FACING * self._goal_checker.tolerance_of(p).angle:
            return still
        way = free_way_round(cycle.checker, state.pose, error)
        if way is None:
            if abs(error) <= self._goal_checker.tolerance_of(p).angle:
                return still
            raise ControlError(
                ControlOutcome.BLOCKED_GOAL,
                f"the robot is at the goal's position and cannot turn by {math.degrees(error):.0f} degrees to its "
                "heading: an obstacle is in the way on both sides",
            )
        return self._turn(cycle, way, still)

    def _turn(self, cycle: ControlCycle, way: float, still: Twist2D) -> Twist2D:
        """Return the command that turns by `way` (rad) on the spot, with the translation of `still`.

        A turn that is free on the spot may not be while the robot still rolls; it then brakes on its arc first.
        """
        if self.parameters.max_vel_theta == 0.0:
            raise ControlError(
                ControlOutcome.NO_VALID_CMD, f"max_vel_theta is 0 and the robot has to turn by {way:.1f} rad")
        rate = turn_rate(way, cycle.velocity.theta, self.parameters, cycle.state.period, cycle.turn)
        command = Twist2D(still.x, still.y, rate)
        if still.speed() > 0.0 and not brakes_free(self.parameters, cycle.state, cycle.checker, command):
            return braked_on_its_arc(self.parameters, cycle)
        return command

    def turn_to_path(self, cycle: ControlCycle, least: float) -> Optional[Twist2D]:
        """Return the command of a turn on the spot to the path; None where none is needed or there is no room for it.

        A turn once begun goes on in its direction until the heading error is below TURNED.

        Args:
            cycle: The working data of this cycle.
            least: Heading error (rad) from which a turn begins.
        """
        state = cycle.state
        ahead = cycle.path.robot_arc + cycle.horizon_scale * cycle.lookahead
        target = cycle.path.point_at(min(ahead, cycle.path.goal_arc))
        dx, dy = target[0] - state.pose.x, target[1] - state.pose.y
        error = (
            angle_between(state.pose.theta, math.atan2(dy, dx))
            if math.hypot(dx, dy) >= HERE * state.costmap.width
            else 0.0
        )
        begun, self._turn_left = self._turn_left, None
        if abs(error) < (TURNED if begun is not None else max(least, TURNED)):
            return None
        if begun is not None and abs(error) > math.pi / 2.0 and error * begun < 0.0:
            error -= math.copysign(2.0 * math.pi, error)
        way: Optional[float] = error
        if free_turn(cycle.checker, state.pose, error) < abs(error) - 1e-9:
            way = free_way_round(cycle.checker, state.pose, angle_between(0.0, error))
        if way is None:
            return None
        self._turn_left = way
        return self._turn(cycle, way, cycle.window.still)

    def nothing_left(self, cycle: ControlCycle, reason: str) -> ControlError:
        """Return the error of a cycle without a possible velocity: COLLISION, BLOCKED_PATH or NO_VALID_CMD."""
        pose: Pose2D = cycle.state.pose
        if cycle.checker.contacts_at(pose):
            costmap = cycle.state.costmap
            outline = costmap.grid.cells_at(pose.transform_points(costmap.footprint))
            where = "lies on an obstacle" if costmap.grid.contains_cells(outline).all() else (
                "reaches beyond the local costmap, which is to be a rolling_window,")
            return ControlError(
                ControlOutcome.COLLISION,
                f"the footprint at ({pose.x:.2f}, {pose.y:.2f}) {where} and no velocity leads away from it: {reason}",
            )
        arc = cycle.path.first_blocked(cycle.checker)
        if arc is not None:
            return ControlError(
                ControlOutcome.BLOCKED_PATH,
                f"an obstacle stands on the path {arc - cycle.path.robot_arc:.2f} m ahead: {reason}",
            )
        why = self._no_room_to_turn(cycle) or "no velocity is left to drive"
        return ControlError(ControlOutcome.NO_VALID_CMD, f"{why}: {reason}")

    def _no_room_to_turn(self, cycle: ControlCycle) -> str:
        """Return the reason why the robot cannot turn to its path; empty where it can."""
        pose = cycle.state.pose
        _ahead, error = direction_of(cycle.path, pose, cycle.state.costmap.width)
        if abs(error) < ASKEW or free_way_round(cycle.checker, pose, error) is not None:
            return ""
        backwards = "" if self.parameters.min_vel_x < 0.0 else ", and it may not drive backwards"
        return f"the path leads off by {math.degrees(error):.0f} degrees and there is no room to turn there{backwards}"
