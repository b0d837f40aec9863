"""What a drive checks beside driving: whether the goal is reached or blocked, and whether the wheels turn."""

from __future__ import annotations

from typing import Optional, Tuple

from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D, Twist2D, angle_between
from mbf_relay.outcomes import ControlError, ControlOutcome

HYSTERESIS = 1.5  # times the tolerance: how far a robot that turns at the goal may drift before it drives again
FACING = 0.5  # times the tolerance: where a turn to the goal's heading ends
CLOSE_ENOUGH = 0.3  # times the tolerance: so near nothing is gained by creeping on
CREEPING = 0.05  # of the top speed: slower than this is standing, whatever the parameters call so
PASSED = 0.35  # rad short of abeam: where the goal counts as beside the robot
MOVED_DISTANCE, MOVED_ANGLE = 0.1, 0.05  # robot's widths and rad that count as having moved
NEAR_GOAL = 4.5  # robot's widths, or a second's drive, from which on it is looked at whether the goal is free
CAR = (
    "; a car, which cannot turn on the spot, needs a controller that knows so, as mppi with motion_model: Ackermann"
)


class GoalChecker:
    """Remembers that the position was reached.

    Source: base_local_planner's LatchedStopRotateController, whose latch here outlives new paths to the same goal.
    """

    def __init__(self) -> None:
        self._turns = self._was_there = False
        self.tolerance: Optional[GoalTolerance] = None

    def reset(self) -> None:
        """Forget what was reached: the goal is a new one."""
        self._turns = self._was_there = False
        self.tolerance = None

    @property
    def turns(self) -> bool:
        """Whether the position was reached when it was looked last."""
        return self._turns

    def tolerance_of(self, parameters: FollowerParameters) -> GoalTolerance:
        """Return the tolerance that holds: the action's where there is one."""
        return GoalTolerance.of(self.tolerance, parameters.xy_goal_tolerance, parameters.yaw_goal_tolerance)

    def is_turning(
        self, state: ControlState, goal: Pose2D, parameters: FollowerParameters, is_occupied: bool
    ) -> bool:
        """Return whether the robot has come near enough to stop and turn to the goal's heading.

        Within tolerance it drives on as long as that brings it nearer, but not to a goal that `is_occupied`; once it
        turns it turns, until it has drifted well out of tolerance, or with latch_xy_goal_tolerance, once it was there
        and not only expected to be, until the goal changes. One that has turned and does not stand within tolerance
        drives again: nothing else would bring it there.
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

        One that is still on its way nearer does not stand, however slow.
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
        """Return whether nothing but the heading counts any more for a robot that turns; asked in every cycle."""
        is_there = (state.pose_now or state.pose).distance_to(goal) <= self.tolerance_of(parameters).distance
        self._was_there = self._was_there or is_there
        return self._was_there and parameters.latch_xy_goal_tolerance


class StuckChecker:
    """Compares what the wheels were told with how the robot moved; turning on the spot is motion."""

    def __init__(self) -> None:
        self._reference: Optional[Tuple[float, Pose2D]] = None
        self._asked_motion = STOP  # m and rad by which it was told to move since then, there and back making nothing
        self._asked_distance = self._asked_angle = 0.0  # the most it was told to be away
        self._last_time: Optional[float] = None

    def reset(self) -> None:
        """Forget the past: the robot was stopped on purpose."""
        self._reference = None

    def check(self, state: ControlState, last_command: Twist2D, timeout: float) -> None:
        """Note one cycle.

        Args:
            state: Now.
            last_command: What the wheels were told since the last cycle.
            timeout: Seconds without motion that mean stuck; 0 switches this off.

        Raises:
            ControlError: ROBOT_STUCK.
        """
        now, here = state.now, state.pose_now or state.pose  # not where it is expected: that moves with each command
        moves = last_command.speed() > 1e-3 or abs(last_command.theta) > 1e-3
        if self._reference is None or self._last_time is None or not moves or not 0.0 <= now - self._last_time < 1.0:
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
    """Sees whether something stands where the robot is to stop."""

    def __init__(self) -> None:
        self._blocked_since: Optional[float] = None

    def reset(self) -> None:
        """Forget the past: the goal is a new one."""
        self._blocked_since = None

    def check(
        self, state: ControlState, path: LocalPath, checker: FootprintChecker, parameters: FollowerParameters,
        tolerance: float,
    ) -> bool:
        """Note one cycle; return whether something stands on the goal, of which the robot sees that from nearby.

        The goal is blocked when the robot's centre could be there in no heading, nor on the path `tolerance` (m) before
        it, and it has been so for blocked_timeout, as seen from nearby, and the robot is not within tolerance.

        Raises:
            ControlError: BLOCKED_GOAL.
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
