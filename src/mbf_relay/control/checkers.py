"""Checks of a drive: whether the goal is reached or blocked, and whether the robot is stuck."""

from __future__ import annotations

from typing import Optional, Tuple

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D, Twist2D, angle_between
from mbf_relay.outcomes import ControlError, ControlOutcome

HYSTERESIS = 1.5  # tolerances by which a robot that turns at the goal may be off before it drives again
FACING = 0.5  # tolerances at which a turn to the goal's heading ends
CLOSE_ENOUGH = 0.3  # tolerances of distance at which the robot stops although it is still getting nearer
CREEPING = 0.05  # share of the top speed below which the robot counts as standing, besides trans_stopped_vel
PASSED = 0.35  # part ahead of the distance to the goal up to which it counts as passed: 20 degrees before abeam
MOVED_DISTANCE, MOVED_ANGLE = 0.1, 0.05  # robot's widths, and rad, from which on the robot has moved
NEAR_GOAL = 4.5  # robot's widths of path left, or a second's drive, within which a blocked goal is looked for
CAR = (
    "; a car, which cannot turn on the spot, needs a controller that knows so, as mppi with motion_model: Ackermann"
)


class GoalChecker:
    """Decides when the robot turns to the goal's heading, and when the goal is reached.

    Source: base_local_planner's LatchedStopRotateController; unlike there, new plans to the same goal keep the latch.
    """

    def __init__(self) -> None:
        self._turns = self._was_there = False
        self.tolerance: Optional[GoalTolerance] = None

    def reset(self) -> None:
        """Forget what was reached, for a new goal."""
        self._turns = self._was_there = False
        self.tolerance = None

    @property
    def turns(self) -> bool:
        """Whether the position counted as reached in the last `update_turning`."""
        return self._turns

    def tolerance_of(self, parameters: FollowerParameters) -> GoalTolerance:
        """Return the action's tolerance, or the parameters' where it has none."""
        return GoalTolerance.of(self.tolerance, parameters.xy_goal_tolerance, parameters.yaw_goal_tolerance)

    def update_turning(
        self, state: ControlState, goal: Pose2D, parameters: FollowerParameters, is_occupied: bool
    ) -> bool:
        """Decide whether the robot is to stop and turn to the goal's heading, and return that.

        Within tolerance it drives on as long as that brings it nearer, unless the goal `is_occupied`. Once begun, the
        turn goes on until the robot is off by HYSTERESIS tolerances; with latch_xy_goal_tolerance, and the tolerance
        really reached (not only predicted across the delay), until the goal changes. A robot that has turned and is
        out of tolerance drives again.
        """
        tolerance, pose = self.tolerance_of(parameters), state.pose
        distance, latched = pose.distance_to(goal), self._latched(state, goal, parameters)
        if self._turns:
            has_turned = abs(angle_between(pose.theta, goal.theta)) <= FACING * tolerance.angle
            drift = 1.0 if has_turned else HYSTERESIS
            self._turns = latched or distance <= drift * tolerance.distance
        elif distance <= tolerance.distance:
            ahead = goal.relative_to(pose)
            passed = ahead.x <= PASSED * distance
            self._turns = passed or is_occupied or distance <= CLOSE_ENOUGH * tolerance.distance
        return self._turns

    def is_reached(self, state: ControlState, goal: Pose2D, parameters: FollowerParameters) -> bool:
        """Return whether the robot stands at the goal, position and heading.

        A robot that still drives nearer does not, even below trans_stopped_vel.
        """
        tolerance = self.tolerance_of(parameters)
        latched = self._turns and self._latched(state, goal, parameters)
        return (
            (self._turns or state.velocity.speed() < CREEPING * parameters.max_vel_trans)
            and (latched or state.pose.distance_to(goal) <= tolerance.distance)
            and abs(angle_between(state.pose.theta, goal.theta)) <= tolerance.angle
            and state.velocity.speed() <= parameters.trans_stopped_vel
            and abs(state.velocity.theta) <= parameters.theta_stopped_vel
        )

    def _latched(self, state: ControlState, goal: Pose2D, parameters: FollowerParameters) -> bool:
        """Return whether the position is latched: only the heading counts. Call it in every cycle."""
        is_there = (state.pose_now or state.pose).distance_to(goal) <= self.tolerance_of(parameters).distance
        self._was_there = self._was_there or is_there
        return self._was_there and parameters.latch_xy_goal_tolerance


class StuckChecker:
    """Compares commands with the robot's motion; turning on the spot counts as motion."""

    def __init__(self) -> None:
        self._reference: Optional[Tuple[float, Pose2D]] = None
        self._asked_motion = STOP  # m, m, rad: integral of the commands since the reference
        self._asked_distance = self._asked_angle = 0.0  # largest magnitudes of that (m, rad)
        self._last_time: Optional[float] = None

    def reset(self) -> None:
        """Forget the past, as after a stop on purpose."""
        self._reference = None

    def check(self, state: ControlState, last_command: Twist2D, timeout: float) -> None:
        """Note one cycle.

        Args:
            state: State of this cycle.
            last_command: Mean velocity sent to the wheels since the last cycle, body frame.
            timeout: Time (s) without motion after which the robot is stuck; 0 switches this off.

        Raises:
            ControlError: ROBOT_STUCK.
        """
        now, here = state.now, state.pose_now or state.pose  # not the predicted pose, which moves with each command
        moves = last_command.speed() > 1e-3 or abs(last_command.theta) > 1e-3
        pause = max(1.0, 2.0 * state.period)  # s
        if self._reference is None or self._last_time is None or not moves or not 0.0 <= now - self._last_time < pause:
            self._restart(state)
            return
        elapsed = now - self._last_time
        self._last_time = now
        asked = self._asked_motion = Twist2D(
            *(so_far + part * elapsed for so_far, part in zip(self._asked_motion, last_command)))
        self._asked_distance = max(self._asked_distance, asked.speed())
        self._asked_angle = max(self._asked_angle, abs(asked.theta))
        since, pose = self._reference
        least = MOVED_DISTANCE * state.costmap.width
        if pose.is_apart(here, least, MOVED_ANGLE):
            self._restart(state)
        elif timeout > 0.0 and now - since >= timeout + state.delay and (
            self._asked_distance > 2.0 * least or self._asked_angle > 2.0 * MOVED_ANGLE
        ):
            self._reference = None
            on_the_spot = self._asked_distance < least
            raise ControlError(
                ControlOutcome.ROBOT_STUCK,
                f"the robot has not moved for {now - since:.1f} s, though {self._asked_distance:.2f} m and "
                f"{self._asked_angle:.2f} rad were commanded; see whether its wheels are free, its motors on, and what "
                f"its velocity_guard says on ~state, where it has one{CAR if on_the_spot else ''}",
            )

    def _restart(self, state: ControlState) -> None:
        self._reference = (state.now, state.pose_now or state.pose)
        self._last_time = state.now
        self._asked_motion, self._asked_distance, self._asked_angle = STOP, 0.0, 0.0


class BlockedGoalChecker:
    """Detects an obstacle on the goal."""

    def __init__(self) -> None:
        self._blocked_since: Optional[float] = None

    def reset(self) -> None:
        """Forget the past, for a new goal."""
        self._blocked_since = None

    def check(
        self, state: ControlState, path: LocalPath, checker: FootprintChecker, parameters: FollowerParameters,
        tolerance: float,
    ) -> bool:
        """Note one cycle; return whether the goal is occupied, which is only looked for near it (see NEAR_GOAL).

        Raises:
            ControlError: BLOCKED_GOAL: for blocked_timeout neither the goal nor the path `tolerance` (m) before it has
                been free for the robot's centre in any heading, and the robot is not within `tolerance`.
        """
        goal = path.goal
        near = path.remaining <= max(NEAR_GOAL * state.costmap.width, parameters.max_vel_trans)
        touches = (
            near
            and state.costmap.grid.contains_point(goal.x, goal.y)
            and self._is_blocked(checker, goal.x, goal.y)
        )
        is_near_enough = state.pose.distance_to(goal) <= tolerance
        if not touches or is_near_enough or not self._is_blocked(checker, *path.point_at(path.goal_arc - tolerance)):
            self._blocked_since = None
            return touches
        if self._blocked_since is None or state.now < self._blocked_since:
            self._blocked_since = state.now
        if state.now - self._blocked_since >= parameters.blocked_timeout:
            raise ControlError(
                ControlOutcome.BLOCKED_GOAL,
                f"an obstacle stands on the goal ({goal.x:.2f}, {goal.y:.2f}) in {state.costmap.frame}; "
                f"the robot is {path.remaining:.2f} m before it",
            )
        return True

    @staticmethod
    def _is_blocked(checker: FootprintChecker, x: float, y: float) -> bool:
        return checker.clearance_at(x, y) < checker.costmap.inscribed_radius
