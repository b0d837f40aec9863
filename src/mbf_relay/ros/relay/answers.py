"""move_base's terminal state and status text for each result of the server.

The texts are exactly move_base's, because clients compare them; the server's reason is kept separately. Outcome codes
differ between versions of mbf_msgs, so they are classified by the constants of the installed messages.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Optional

from actionlib_msgs.msg import GoalStatus
from mbf_msgs.msg import ExePathResult, GetPathResult, MoveBaseResult, RecoveryResult

from mbf_relay.ros.common.checks import quaternion_length
from mbf_relay.ros.common.outcome_codes import name_of

GOAL_REACHED = "Goal reached."
NO_PLAN = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL = "Failed to find a valid control. Even after executing recovery behaviors."
OSCILLATING = "Robot is oscillating. Even after executing recovery behaviors."
INVALID_QUATERNION = "Aborting on goal because it was sent with an invalid quaternion"
NODE_KILLED = "Aborting on the goal because the node has been killed"
ACCEPTED = "This goal has been accepted by the simple action server"
REPLACED = "This goal was canceled because another goal was recieved by the simple action server"
"""actionlib's text, misspelt as there."""
SHORTEST_QUATERNION = 1e-3
"""Length below which a quaternion is no rotation, as in move_base."""
MOST_TILT = 1e-3
"""How far the cosine of the angle between a goal's z axis and the vertical may be from 1, as in move_base."""


class Answer(NamedTuple):
    """A terminal state for a client's goal.

    Attributes:
        status: GoalStatus.SUCCEEDED, PREEMPTED or ABORTED; move_base rejects nothing.
        text: move_base's status text.
        reason: Explanation of the server or the relay, for the log and ~navigation_outcome.
    """

    status: int
    text: str
    reason: str = ""

    def give(self, client_goal: Any) -> None:
        """Set the state and text of a client's goal."""
        if self.status == GoalStatus.SUCCEEDED:
            client_goal.set_succeeded(None, self.text)
        elif self.status == GoalStatus.PREEMPTED:
            client_goal.set_canceled(None, self.text)
        else:
            client_goal.set_aborted(None, self.text)


def preempted(text: str = "", reason: str = "") -> Answer:
    """Return the answer to a goal that was cancelled or replaced."""
    return Answer(GoalStatus.PREEMPTED, text, reason)


def aborted(text: str, reason: str = "") -> Answer:
    """Return the answer to a goal that failed."""
    return Answer(GoalStatus.ABORTED, text, reason or text)


def server_absent(parameters: Any) -> Answer:
    """Return the answer to a goal for which no server came within server_timeout."""
    return aborted(
        f"No Move Base Flex server '{parameters.server}' within {parameters.server_timeout:g} s; is it running?"
    )


def answer_to(ending: Any, cancelled: bool) -> Answer:
    """Return move_base's answer for the way a goal ended at the server.

    Where state and outcome contradict each other the answer is a failure. A goal that the server cancelled by itself,
    with another outcome than a cancel, has failed too: the C++ server does so for an unknown plugin.

    Args:
        ending: The server's status, text and result.
        cancelled: Whether the client had cancelled the goal.
    """
    if ending.status == GoalStatus.LOST:
        return aborted(_sentence(ending.text))
    outcome = None if ending.result is None else ending.result.outcome
    message = ending.text if ending.result is None else ending.result.message or ending.text
    reason = message if outcome is None else f"{outcome_name(outcome)}: {message}"
    if ending.status == GoalStatus.SUCCEEDED and outcome in (None, MoveBaseResult.SUCCESS):
        return Answer(GoalStatus.SUCCEEDED, GOAL_REACHED, reason)
    was_cancelled = ending.status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
    if is_cancel(outcome) or (was_cancelled and (cancelled or outcome in (None, MoveBaseResult.SUCCESS))):
        return preempted("" if cancelled else message, reason)
    return aborted(failure_text(outcome), reason)


def not_finite(pose: Any) -> Optional[Answer]:
    """Return the answer to a goal whose pose has NaN or infinity, None for any other."""
    where, turn = pose.position, pose.orientation
    if not all(map(math.isfinite, (turn.x, turn.y, turn.z, turn.w))):
        return aborted(INVALID_QUATERNION, f"quaternion ({turn.x}, {turn.y}, {turn.z}, {turn.w}) is not finite")
    if not all(map(math.isfinite, (where.x, where.y, where.z))):
        return aborted(NO_PLAN, f"position ({where.x}, {where.y}, {where.z}) is not finite")
    return None


def doubt_of_arrival(ending: Any, target: Any, tolerance: float) -> str:
    """Return why a reported arrival is not accepted; empty where it is, or the goal did not succeed.

    The C++ server may report the success of a replaced goal as that of the new one. The result's final_pose and
    dist_to_goal still tell where the robot was.

    Args:
        ending: The server's status, text and result.
        target: The goal's PoseStamped.
        tolerance: Largest accepted distance (m) from the goal (arrival_tolerance).
    """
    if ending.status != GoalStatus.SUCCEEDED or ending.result is None:
        return ""
    distance = getattr(ending.result, "dist_to_goal", 0.0)
    distances = [distance] if math.isfinite(distance) else []
    final = getattr(ending.result, "final_pose", None)
    if final is not None and final.header.frame_id and same_frame(final.header.frame_id, target.header.frame_id):
        here, there = final.pose.position, target.pose.position
        distances.append(math.hypot(here.x - there.x, here.y - there.y))
    farthest = max(distances, default=0.0)
    if farthest <= tolerance:
        return ""
    return (
        f"the server claims to have arrived, {farthest:.2f} m from the goal; arrival_tolerance is {tolerance:g} m, and "
        "must be at least the controller's own")


def not_arrived(doubt: str, cancelled: bool) -> Answer:
    """Return the answer to a goal whose reported arrival is not accepted."""
    return preempted(reason=doubt) if cancelled else aborted(NO_CONTROL, doubt)


def same_frame(one: str, other: str) -> bool:
    """Return whether two names mean the same frame, with or without a leading slash."""
    return one.lstrip("/") == other.lstrip("/")


def failure_text(outcome: Optional[int]) -> str:
    """Return which of move_base's three failure texts fits an outcome code.

    Failures of neither planning nor control (no transform, no plugin, an internal error) are counted as planning.
    """
    if outcome in (_code(MoveBaseResult, "OSCILLATION"), _code(ExePathResult, "OSCILLATION")):
        return OSCILLATING
    control = (_code(MoveBaseResult, "COLLISION"), _code(MoveBaseResult, "CTRL_FAILURE"))
    if outcome in control or (outcome is not None and ExePathResult.FAILURE <= outcome < RecoveryResult.FAILURE):
        return NO_CONTROL
    return NO_PLAN


def is_cancel(outcome: Optional[int]) -> bool:
    """Return whether an outcome code is a CANCELED of any of the four actions."""
    codes = [_code(kind, "CANCELED") for kind in (MoveBaseResult, GetPathResult, ExePathResult, RecoveryResult)]
    return outcome is not None and outcome in codes


def outcome_name(outcome: int) -> str:
    """Return an outcome's name in the action it comes from, e.g. "GetPath BLOCKED_GOAL"."""
    kinds = ((RecoveryResult, "Recovery"), (ExePathResult, "ExePath"), (GetPathResult, "GetPath"))
    for kind, action in kinds:
        if outcome >= kind.FAILURE:
            return f"{action} {name_of(outcome, kind)}"
    return name_of(outcome, MoveBaseResult)


def is_upright(quaternion: Any) -> bool:
    """Return whether move_base accepts a goal's quaternion: finite, not zero, and a rotation about the z axis."""
    length = quaternion_length(quaternion)
    if not math.isfinite(length) or length < SHORTEST_QUATERNION:
        return False
    return 2.0 * math.hypot(quaternion.x / length, quaternion.y / length) ** 2 <= MOST_TILT


def _code(kind: Any, name: str) -> Optional[int]:
    """Return a message's constant, None where the installed version lacks it."""
    return getattr(kind, name, None)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
