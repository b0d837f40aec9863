"""Watching for what no velocity can mend: wheels that do not turn, a goal that something stands on."""

from __future__ import annotations

from typing import Optional, Tuple

from mbf_relay.control.controller import ControlState
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.obstacle_view import ObstacleView
from mbf_relay.geometry import Pose2D, Twist2D, angle_between
from mbf_relay.outcomes import ControlError, ControlOutcome

MOVED_DISTANCE = 0.02  # m and rad that count as having moved
MOVED_ANGLE = 0.05


class StuckGuard:
    """Compares what was commanded with how the robot moved; turning on the spot is motion."""

    def __init__(self) -> None:
        self._reference: Optional[Tuple[float, Pose2D]] = None
        self._asked_distance = 0.0
        self._asked_angle = 0.0
        self._last_time: Optional[float] = None

    def reset(self) -> None:
        """Forget the past: the robot was stopped on purpose."""
        self._reference = None

    def check(self, state: ControlState, last_command: Twist2D, timeout: float) -> None:
        """Note one cycle.

        Args:
            state: Now.
            last_command: What was commanded until now.
            timeout: Seconds without motion that mean stuck; 0 switches this off.

        Raises:
            ControlError: ROBOT_STUCK.
        """
        now = state.now
        moves = last_command.speed() > 1e-3 or abs(last_command.theta) > 1e-3
        if self._reference is None or self._last_time is None or not moves or not 0.0 <= now - self._last_time < 1.0:
            self._restart(state)
            return
        elapsed = now - self._last_time
        self._last_time = now
        self._asked_distance += last_command.speed() * elapsed
        self._asked_angle += abs(last_command.theta) * elapsed
        since, pose = self._reference
        moved = pose.distance_to(state.pose) > MOVED_DISTANCE or abs(angle_between(pose.theta, state.pose.theta)) > MOVED_ANGLE
        if moved:
            self._restart(state)
        elif timeout > 0.0 and now - since >= timeout and (
            self._asked_distance > 2.0 * MOVED_DISTANCE or self._asked_angle > 2.0 * MOVED_ANGLE
        ):
            self._reference = None
            raise ControlError(
                ControlOutcome.ROBOT_STUCK,
                f"the robot has not moved for {now - since:.1f} s, though {self._asked_distance:.2f} m and "
                f"{self._asked_angle:.2f} rad were commanded; see whether its wheels are free and its motors on",
            )

    def _restart(self, state: ControlState) -> None:
        self._reference = (state.now, state.pose)
        self._last_time = state.now
        self._asked_distance = self._asked_angle = 0.0


class GoalGuard:
    """Sees whether something stands where the robot is to stop."""

    def __init__(self) -> None:
        self._blocked_since: Optional[float] = None

    def reset(self) -> None:
        """Forget the past: the goal is a new one."""
        self._blocked_since = None

    def check(self, state: ControlState, path: LocalPath, view: ObstacleView, parameters: FollowerParameters) -> None:
        """Note one cycle.

        The goal is blocked when the robot's centre could not be there in any heading, and it has been so for
        blocked_timeout, as seen from within a second's drive.

        Raises:
            ControlError: BLOCKED_GOAL.
        """
        goal = path.goal
        near = path.remaining <= max(1.0, parameters.max_vel_trans)
        touches = near and state.costmap.grid.contains_point(goal.x, goal.y) and self._is_blocked(view, goal, state.costmap)
        if not touches or state.pose.distance_to(goal) <= parameters.xy_goal_tolerance:
            self._blocked_since = None
            return
        if self._blocked_since is None or state.now < self._blocked_since:
            self._blocked_since = state.now
        if state.now - self._blocked_since >= parameters.blocked_timeout:
            raise ControlError(
                ControlOutcome.BLOCKED_GOAL,
                f"an obstacle stands on the goal ({goal.x:.2f}, {goal.y:.2f}) in {state.costmap.frame}; "
                f"the robot is {path.remaining:.2f} m before it",
            )

    @staticmethod
    def _is_blocked(view: ObstacleView, goal: Pose2D, costmap: "object") -> bool:
        return view.clearance_at(goal.x, goal.y) < view.costmap.inscribed_radius
