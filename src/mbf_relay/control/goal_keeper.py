"""Whether the robot is at the goal's position, and at the goal: with a latch that only a new goal resets."""

from __future__ import annotations

from typing import Optional

from mbf_relay.control.controller import ControlState, GoalTolerance
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.geometry import Pose2D, angle_between

HYSTERESIS = 1.5  # times the tolerance: how far a robot that turns at the goal may drift before it drives again
CLOSE_ENOUGH = 0.3  # times the tolerance: so near nothing is gained by creeping on
CREEPING = 0.01  # m/s: slower than this is standing, whatever the parameters call so
PASSED = 0.35  # rad short of abeam: where the goal counts as beside the robot


class GoalKeeper:
    """Remembers that the position was reached.

    Source: base_local_planner's LatchedStopRotateController, whose latch here outlives new paths to the same goal.
    """

    def __init__(self) -> None:
        self._turns = False
        self.tolerance: Optional[GoalTolerance] = None

    def reset(self) -> None:
        """Forget what was reached: the goal is a new one."""
        self._turns = False
        self.tolerance = None

    def tolerance_of(self, parameters: FollowerParameters) -> GoalTolerance:
        """Return the tolerance that holds: the action's where there is one."""
        return self.tolerance or GoalTolerance(parameters.xy_goal_tolerance, parameters.yaw_goal_tolerance)

    def is_turning(self, pose: Pose2D, goal: Pose2D, parameters: FollowerParameters) -> bool:
        """Tell whether the robot has come near enough to stop and turn to the goal's heading.

        Within tolerance it drives on as long as that brings it nearer; once it turns it turns, until it has drifted
        well out of tolerance, or with latch_xy_goal_tolerance until the goal changes.
        """
        tolerance = self.tolerance_of(parameters).distance
        distance = pose.distance_to(goal)
        if self._turns:
            self._turns = parameters.latch_xy_goal_tolerance or distance <= HYSTERESIS * tolerance
        elif distance <= tolerance:
            ahead = goal.relative_to(pose)
            passed = ahead.x <= PASSED * distance
            self._turns = passed or distance <= CLOSE_ENOUGH * tolerance
        return self._turns

    def is_reached(self, state: ControlState, goal: Pose2D, parameters: FollowerParameters) -> bool:
        """Tell whether the robot stands at the goal, position and heading.

        One that is still on its way nearer does not stand, however slow.
        """
        tolerance = self.tolerance_of(parameters)
        latched = self._turns and parameters.latch_xy_goal_tolerance
        return (
            (self._turns or state.velocity.speed() < CREEPING)
            and (latched or state.pose.distance_to(goal) <= tolerance.distance)
            and abs(angle_between(state.pose.theta, goal.theta)) <= tolerance.angle
            and state.velocity.speed() <= parameters.trans_stopped_vel
            and abs(state.velocity.theta) <= parameters.theta_stopped_vel
        )
