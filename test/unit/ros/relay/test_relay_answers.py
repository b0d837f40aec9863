"""What move_base says for what the server says, with the numbers of both versions of mbf_msgs."""

from types import SimpleNamespace

import pytest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Pose, PoseStamped, Quaternion

from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.ros.common.actions.client_goals import ActionEnding
from mbf_relay.ros.common.outcome_codes import code_of
from mbf_relay.ros.relay import answers


def constants(first, *names, **others):
    return SimpleNamespace(SUCCESS=0, **{name: first + i for i, name in enumerate(names)}, **others)


GENERAL = (
    "FAILURE",
    "CANCELED",
    "COLLISION",
    "OSCILLATION",
    "START_BLOCKED",
    "GOAL_BLOCKED",
    "TF_ERROR",
    "INTERNAL_ERROR",
)
PLAN_END = ("NO_PATH_FOUND", "PAT_EXCEEDED", "EMPTY_PATH", "TF_ERROR", "NOT_INITIALIZED", "INVALID_PLUGIN",
            "INTERNAL_ERROR", "OUT_OF_MAP", "MAP_ERROR", "STOPPED")
CONTROL = ("FAILURE", "CANCELED", "NO_VALID_CMD", "PAT_EXCEEDED", "COLLISION", "OSCILLATION", "ROBOT_STUCK",
           "MISSED_GOAL", "MISSED_PATH")
CONTROL_END = ("BLOCKED_PATH", "INVALID_PATH", "TF_ERROR", "NOT_INITIALIZED", "INVALID_PLUGIN", "INTERNAL_ERROR",
               "OUT_OF_MAP", "MAP_ERROR", "STOPPED")
RECOVERY = ("FAILURE", "CANCELED", "PAT_EXCEEDED", "TF_ERROR", "NOT_INITIALIZED", "INVALID_PLUGIN", "INTERNAL_ERROR",
            "STOPPED", "IMPASSABLE")
RELEASE_0_4_0 = dict(
    MoveBaseResult=constants(10, *GENERAL, PLAN_FAILURE=50, CTRL_FAILURE=100),
    GetPathResult=constants(50, "FAILURE", "CANCELED", "INVALID_START", "INVALID_GOAL", *PLAN_END),
    ExePathResult=constants(100, *CONTROL, *CONTROL_END),
    RecoveryResult=constants(150, *RECOVERY),
)
MASTER = dict(
    MoveBaseResult=constants(10, *GENERAL, PLAN_FAILURE=50, CTRL_FAILURE=100),
    GetPathResult=constants(50, "FAILURE", "CANCELED", "INVALID_START", "INVALID_GOAL", "BLOCKED_START", "BLOCKED_GOAL",
                            *PLAN_END, ERROR_RANGE_START=50, ERROR_RANGE_END=99),
    ExePathResult=constants(100, *CONTROL, "BLOCKED_GOAL", *CONTROL_END, ERROR_RANGE_START=100, ERROR_RANGE_END=149),
    RecoveryResult=constants(150, *RECOVERY, ERROR_RANGE_START=150, ERROR_RANGE_END=199),
)


@pytest.fixture(params=[RELEASE_0_4_0, MASTER], ids=["0.4.0", "master"])
def numbers(request, monkeypatch):
    for name, kind in request.param.items():
        monkeypatch.setattr(answers, name, kind)
    return SimpleNamespace(**request.param)


def answer(status, outcome, cancelled=False, message="why", text=""):
    result = None if outcome is None else SimpleNamespace(outcome=outcome, message=message)
    return answers.answer_to(ActionEnding(status, text, result), cancelled)


@pytest.mark.parametrize("action, name, text", [
    ("MoveBaseResult", "FAILURE", answers.NO_PLAN), ("MoveBaseResult", "COLLISION", answers.NO_CONTROL),
    ("MoveBaseResult", "OSCILLATION", answers.OSCILLATING), ("MoveBaseResult", "START_BLOCKED", answers.NO_PLAN),
    ("MoveBaseResult", "GOAL_BLOCKED", answers.NO_PLAN), ("MoveBaseResult", "TF_ERROR", answers.NO_PLAN),
    ("MoveBaseResult", "PLAN_FAILURE", answers.NO_PLAN), ("MoveBaseResult", "CTRL_FAILURE", answers.NO_CONTROL),
    ("GetPathResult", "NO_PATH_FOUND", answers.NO_PLAN), ("GetPathResult", "STOPPED", answers.NO_PLAN),
    ("GetPathResult", "INVALID_GOAL", answers.NO_PLAN), ("ExePathResult", "STOPPED", answers.NO_CONTROL),
    ("ExePathResult", "NO_VALID_CMD", answers.NO_CONTROL), ("ExePathResult", "ROBOT_STUCK", answers.NO_CONTROL),
    ("ExePathResult", "OSCILLATION", answers.OSCILLATING), ("RecoveryResult", "IMPASSABLE", answers.NO_PLAN),
])
def test_a_failure_has_move_bases_text_and_the_servers_reason(numbers, action, name, text):
    outcome = getattr(getattr(numbers, action), name)
    found = answer(GoalStatus.ABORTED, outcome)
    assert (found.status, found.text) == (GoalStatus.ABORTED, text)
    assert "why" in found.reason


@pytest.mark.parametrize("status", [GoalStatus.PREEMPTED, GoalStatus.RECALLED, GoalStatus.ABORTED])
def test_canceled_is_preempted_whoever_asked(numbers, status):
    for action in (numbers.MoveBaseResult, numbers.GetPathResult, numbers.ExePathResult, numbers.RecoveryResult):
        assert answer(status, action.CANCELED).status == GoalStatus.PREEMPTED


def test_a_client_whose_server_is_shut_down_is_not_told_that_somebody_cancelled(numbers):
    outcome = code_of(NavigateOutcome.STOPPED, numbers.MoveBaseResult)
    found = answer(GoalStatus.ABORTED, outcome, message="move_base_flex is shutting down")
    assert (found.status, found.text) == (GoalStatus.ABORTED, answers.NO_PLAN)
    assert "is shutting down" in found.reason


def test_a_server_that_cancels_with_an_error_has_failed_unless_it_was_asked(numbers):
    outcome = numbers.ExePathResult.INVALID_PLUGIN
    assert answer(GoalStatus.PREEMPTED, outcome).status == GoalStatus.ABORTED
    assert answer(GoalStatus.PREEMPTED, outcome, cancelled=True).status == GoalStatus.PREEMPTED


def test_who_called_a_goal_off_hears_nothing_as_from_move_base_and_whoever_did_not_hears_why(numbers):
    canceled = numbers.MoveBaseResult.CANCELED
    assert answer(GoalStatus.PREEMPTED, canceled, cancelled=True).text == ""
    assert answer(GoalStatus.PREEMPTED, canceled).text == "why"


def test_a_recalled_goals_empty_result_is_no_success(numbers):
    assert answer(GoalStatus.RECALLED, 0).status == GoalStatus.PREEMPTED
    assert answer(GoalStatus.RECALLED, None).status == GoalStatus.PREEMPTED


def test_state_and_outcome_must_both_say_success(numbers):
    assert answer(GoalStatus.SUCCEEDED, 0) == answers.Answer(GoalStatus.SUCCEEDED, "Goal reached.", "SUCCESS: why")
    assert answer(GoalStatus.SUCCEEDED, numbers.ExePathResult.COLLISION).status == GoalStatus.ABORTED
    assert answer(GoalStatus.ABORTED, 0).status == GoalStatus.ABORTED
    assert answer(GoalStatus.SUCCEEDED, None).status == GoalStatus.SUCCEEDED


def test_a_plugins_own_number_is_known_by_its_group(numbers):
    assert answer(GoalStatus.ABORTED, 80).text == answers.NO_PLAN
    assert answer(GoalStatus.ABORTED, 130).text == answers.NO_CONTROL


def test_the_reason_names_action_and_outcome():
    from mbf_msgs.msg import ExePathResult, GetPathResult, MoveBaseResult

    assert answers.outcome_name(GetPathResult.NO_PATH_FOUND) == "GetPath NO_PATH_FOUND"
    assert answers.outcome_name(ExePathResult.OSCILLATION) == "ExePath OSCILLATION"
    assert answers.outcome_name(MoveBaseResult.TF_ERROR) == "TF_ERROR"
    assert answers.outcome_name(85) == "GetPath 85"


@pytest.mark.parametrize("quaternion, upright", [
    ((0, 0, 0, 1), True), ((0, 0, 5, 0), True), ((0, 0, -0.112, 0.999), True), ((0, 0, 0, -1), True),
    ((0, 0, 0, 0), False), ((0, 0, 0, 9e-4), False), ((1, 0, 0, 0), False), ((0.05, 0, 0, 1), False),
    ((0.01, 0.01, 0.7, 0.7), True), ((0.003, 0, 0, 0.1), False), ((0.001, 0, 0, 0.1), True),
    ((float("nan"), 0, 0, 1), False), ((0, 0, float("inf"), 1), False),
])
def test_quaternions_are_judged_as_move_base_does(quaternion, upright):
    assert answers.is_upright(Quaternion(*quaternion)) is upright


def pose_at(x, y, frame="map"):
    pose = PoseStamped(pose=Pose())
    pose.header.frame_id, pose.pose.position.x, pose.pose.position.y = frame, x, y
    return pose


@pytest.mark.parametrize("status, result, doubted", [
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(1.0, 2.1), dist_to_goal=0.1), False),
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(1.0, -2.0), dist_to_goal=0.1), True),
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(-1.0, 2.0), dist_to_goal=0.1), True),
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(9.0, 9.0, "odom"), dist_to_goal=0.1), False),
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(9.0, 9.0, "/map"), dist_to_goal=0.1), True),
    (GoalStatus.SUCCEEDED, SimpleNamespace(final_pose=pose_at(0.0, 0.0, ""), dist_to_goal=0.1), False),
    (GoalStatus.SUCCEEDED, SimpleNamespace(dist_to_goal=3.0), True),
    (GoalStatus.SUCCEEDED, SimpleNamespace(), False),
    (GoalStatus.SUCCEEDED, None, False),
    (GoalStatus.ABORTED, SimpleNamespace(final_pose=pose_at(9.0, 9.0), dist_to_goal=8.0), False),
])
def test_an_arrival_is_doubted_by_where_the_robot_stands_and_by_nothing_that_cannot_be_compared(
        status, result, doubted):
    """A robot whose pose was told in another frame, or by an older server, would have been sent to its goal again."""
    assert bool(answers.doubt_of_arrival(ActionEnding(status, "", result), pose_at(1.0, 2.0), 0.5)) is doubted
