"""Conversions of mbf_msgs' goals to the package's own, and of its feedback and results to mbf_msgs'."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, Optional, Union

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from mbf_msgs.msg import (
    ExePathFeedback,
    ExePathGoal,
    ExePathResult,
    GetPathGoal,
    GetPathResult,
    MoveBaseFeedback,
    MoveBaseGoal,
    MoveBaseResult,
    RecoveryGoal,
    RecoveryResult,
)

from mbf_relay.control.state import GoalTolerance
from mbf_relay.navigation.goals import (
    FollowFeedback,
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
from mbf_relay.outcomes import ControlError, ControlOutcome, PlanningError, PlanOutcome, RecoveryOutcome
from mbf_relay.ros.common.checks import InvalidMessage, shown
from mbf_relay.ros.common.conversions import (
    path_from_message,
    path_to_message,
    pose_from_message,
    pose_stamped,
    twist_to_message,
)
from mbf_relay.ros.common.outcome_codes import code_of

FLOAT32_MAX = float(np.finfo(np.float32).max)
"""Largest finite float32."""

RESULT_TYPES = {PlanOutcome: GetPathResult, ControlOutcome: ExePathResult, RecoveryOutcome: RecoveryResult}
"""Message whose constants number an enumeration's outcomes; move_base's result may have any of them."""


def framed_pose(message: PoseStamped) -> FramedPose:
    """Return a stamped pose in the plane; raise InvalidMessage where it is not finite or its quaternion is zero."""
    return FramedPose(pose_from_message(message.pose), message.header.frame_id.lstrip("/"))


def check_tolerance(tolerance: float) -> None:
    """Raise PlanningError where a goal tolerance (m) is negative or not finite."""
    if not (math.isfinite(tolerance) and tolerance >= 0.0):
        raise PlanningError(PlanOutcome.INVALID_GOAL, f"tolerance is {tolerance} m; it must be 0 or above")


def plan_goal(goal: GetPathGoal) -> PlanGoal:
    """Return a get_path goal; raise PlanningError where a pose or the tolerance is invalid."""
    check_tolerance(goal.tolerance)
    start = None
    if goal.use_start_pose:
        start = _checked_pose(goal.start_pose, PlanOutcome.INVALID_START, "start pose")
    target = _checked_pose(goal.target_pose, PlanOutcome.INVALID_GOAL, "target pose")
    return PlanGoal(target, start, goal.tolerance, goal.planner, goal.concurrency_slot)


def navigate_goal(goal: MoveBaseGoal) -> NavigateGoal:
    """Return a move_base goal; raise PlanningError where its pose is invalid."""
    target = _checked_pose(goal.target_pose, PlanOutcome.INVALID_GOAL, "target pose")
    return NavigateGoal(target, goal.planner, goal.controller, tuple(goal.recovery_behaviors))


def _checked_pose(message: PoseStamped, outcome: PlanOutcome, what: str) -> FramedPose:
    try:
        return framed_pose(message)
    except InvalidMessage as error:
        raise PlanningError(outcome, f"{what}: {error}") from error


def follow_goal(goal: ExePathGoal) -> FollowGoal:
    """Return an exe_path goal; raise ControlError where path or tolerance is invalid."""
    message = goal.path
    if not message.poses:
        raise ControlError(ControlOutcome.INVALID_PATH, "Controller started with an empty plan!")
    message.header.frame_id = _frame_of_path(message)
    tolerance = None
    if goal.tolerance_from_action:
        tolerance = GoalTolerance(goal.dist_tolerance, goal.angle_tolerance)
        for name, value in (("dist_tolerance", tolerance.distance), ("angle_tolerance", tolerance.angle)):
            if not (math.isfinite(value) and value >= 0.0):
                raise ControlError(ControlOutcome.FAILURE, f"{name} is {value}; it must be 0 or above")
    try:
        path = path_from_message(message)
    except InvalidMessage as error:
        raise ControlError(ControlOutcome.INVALID_PATH, str(error)) from error
    return FollowGoal(path, goal.controller, goal.concurrency_slot, tolerance)


def _frame_of_path(message: Any) -> str:
    """Return the frame of a path's poses, as Move Base Flex does; that of the path's header where they name none.

    Raises:
        ControlError: The poses are in different frames.
    """
    frames = sorted({stamped.header.frame_id.lstrip("/") for stamped in message.poses} - {""})
    if len(frames) > 1:
        raise ControlError(
            ControlOutcome.INVALID_PATH,
            f"the path's poses are in frames '{shown(frames[0])}' and '{shown(frames[1])}'; they must all be in one")
    frame: str = frames[0] if frames else message.header.frame_id.lstrip("/")
    return frame


def recover_goal(goal: RecoveryGoal) -> RecoverGoal:
    """Return a recovery goal."""
    return RecoverGoal(goal.behavior, goal.concurrency_slot)


def outcome_code(outcome: Enum, own_type: Any) -> int:
    """Return an outcome's number by the message in RESULT_TYPES, or by `own_type` for other enumerations."""
    return code_of(outcome, RESULT_TYPES.get(type(outcome), own_type))


def plan_result(result: PlanResult, stamp: Any) -> GetPathResult:
    """Return the result of get_path as a message."""
    message = GetPathResult(outcome=code_of(result.outcome, GetPathResult), message=result.message, cost=result.cost)
    message.path.header.stamp = stamp
    if result.path is not None:
        message.path = path_to_message(result.path, stamp)
    return message


def follow_result(result: FollowResult, stamp: Any) -> ExePathResult:
    """Return the result of exe_path as a message."""
    return _result_of_a_drive(result, stamp, ExePathResult)


def recover_result(result: RecoverResult, _stamp: Any) -> RecoveryResult:
    """Return the result of recovery as a message."""
    message = RecoveryResult(outcome=code_of(result.outcome, RecoveryResult), message=result.message)
    if hasattr(message, "used_plugin"):
        message.used_plugin = result.used_plugin
    return message


def navigate_result(result: NavigateResult, stamp: Any) -> MoveBaseResult:
    """Return the result of move_base as a message."""
    return _result_of_a_drive(result, stamp, MoveBaseResult)


def _result_of_a_drive(result: Union[FollowResult, NavigateResult], stamp: Any, result_type: Any) -> Any:
    """Return the result of exe_path, or of move_base, which has the same fields."""
    return result_type(
        outcome=outcome_code(result.outcome, result_type),
        message=result.message,
        final_pose=_pose(result.pose, stamp),
        dist_to_goal=_float32(result.distance),
        angle_to_goal=_float32(result.angle),
    )


def follow_feedback(
    feedback: FollowFeedback, stamp: Any, robot_frame: str, feedback_type: Any = ExePathFeedback
) -> Any:
    """Return a control cycle as feedback of exe_path, or of move_base, which has the same fields."""
    twist = TwistStamped(twist=twist_to_message(feedback.velocity))
    twist.header.stamp, twist.header.frame_id = stamp, robot_frame
    return feedback_type(
        outcome=code_of(feedback.outcome, ExePathResult),
        message=feedback.message,
        dist_to_goal=_float32(feedback.distance),
        angle_to_goal=_float32(feedback.angle),
        current_pose=_pose(feedback.pose, stamp),
        last_cmd_vel=twist,
    )


def navigate_feedback(feedback: FollowFeedback, stamp: Any, robot_frame: str) -> MoveBaseFeedback:
    """Return a control cycle as move_base's feedback."""
    return follow_feedback(feedback, stamp, robot_frame, MoveBaseFeedback)


def _pose(pose: Optional[FramedPose], stamp: Any) -> PoseStamped:
    return PoseStamped() if pose is None else pose_stamped(pose.pose, pose.frame, stamp)


def _float32(value: float) -> float:
    """Return a number clamped to the range of float32; infinity stays."""
    return value if math.isinf(value) else min(value, FLOAT32_MAX)
