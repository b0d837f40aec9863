"""The relay's core, state by state, between stand-ins."""

import pytest
from fake_server import (
    ABORTED,
    ACTIVE,
    LOST,
    PENDING,
    PREEMPTED,
    PREEMPTING,
    RECALLED,
    REJECTED,
    SUCCEEDED,
    PaperClientGoal,
    Setup,
)
from mbf_msgs.msg import ExePathResult, GetPathResult, MoveBaseResult

from mbf_relay.ros.relay import answers


@pytest.fixture
def setup():
    return Setup()


def test_a_goal_is_accepted_sent_and_answered(setup):
    goal = setup.goal(x=3.0)
    assert goal.states == [PENDING, ACTIVE]
    assert setup.server.sent[0].goal.pose.position.x == 3.0
    setup.server.sent[0].end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert (goal.state, goal.text) == (SUCCEEDED, "Goal reached.")
    assert not setup.relay.is_pursuing


@pytest.mark.parametrize("status, outcome, state, text", [
    (ABORTED, GetPathResult.NO_PATH_FOUND, ABORTED, answers.NO_PLAN),
    (ABORTED, ExePathResult.PAT_EXCEEDED, ABORTED, answers.NO_CONTROL),
    (ABORTED, MoveBaseResult.OSCILLATION, ABORTED, answers.OSCILLATING),
    (REJECTED, GetPathResult.INVALID_PLUGIN, ABORTED, answers.NO_PLAN),
    (PREEMPTED, MoveBaseResult.CANCELED, PREEMPTED, ""),
    (RECALLED, None, PREEMPTED, ""),
    (SUCCEEDED, ExePathResult.COLLISION, ABORTED, answers.NO_CONTROL),
])
def test_the_servers_end_becomes_move_bases(setup, status, outcome, state, text):
    goal = setup.goal()
    setup.server.sent[0].end(status, outcome)
    assert (goal.state, goal.text) == (state, text)


def test_feedback_goes_through_in_order_and_only_to_the_goal_it_is_for(setup):
    first = setup.goal()
    back = setup.server.sent[0]
    for x in range(5):
        back.say(float(x))
    second = setup.goal()
    back.say(99.0)
    assert [pose.pose.position.x for pose in first.feedback] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert second.feedback == []


def test_a_newer_goal_preempts_without_stopping_the_robot(setup):
    old, new = setup.goal(), setup.goal()
    assert (old.state, old.text, new.state) == (PREEMPTED, answers.REPLACED, ACTIVE)
    assert setup.server.sent[0].cancels == 0 and len(setup.server.sent) == 2
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    assert new.state == ACTIVE


def test_a_goal_older_than_the_newest_is_recalled(setup):
    new, old = setup.goal(stamp=10.0), setup.goal(stamp=9.0)
    assert (new.state, old.state, old.text) == (ACTIVE, RECALLED, answers.REPLACED)
    assert setup.goal(stamp=10.0).state == ACTIVE, "of two with one stamp the later to arrive wins"


def test_goals_are_taken_again_after_the_clock_was_set_back(setup):
    setup.goal(stamp=1000.0, ros_now=1000.0)
    assert setup.goal(stamp=5.0, ros_now=5.0).state == ACTIVE
    assert setup.goal(stamp=6.0, ros_now=6.0).state == ACTIVE
    assert setup.goal(stamp=5.5, ros_now=6.0).state == RECALLED


def test_cancel_reaches_the_server_and_its_answer_the_client(setup):
    goal = setup.goal()
    setup.cancel(goal)
    assert goal.state == PREEMPTING and setup.server.sent[0].cancels == 1
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    assert goal.states == [PENDING, ACTIVE, PREEMPTING, PREEMPTED]


def test_a_goal_reached_while_its_cancel_was_under_way_is_reached(setup):
    goal = setup.goal()
    setup.cancel(goal)
    setup.server.sent[0].end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert goal.state == SUCCEEDED


def test_a_robot_stands_where_the_cancel_of_the_goal_that_replaces_its_own_comes_first(setup):
    driving = setup.goal()
    setup.relay.take_overtaken(PaperClientGoal("newer", 2.0), 1e6)
    assert (driving.state, driving.text) == (PREEMPTED, answers.REPLACED)
    assert setup.server.sent[0].cancels == 1 and len(setup.server.sent) == 1
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    assert setup.goal(stamp=1.5).state == RECALLED  # older than the newest


@pytest.mark.parametrize("details", [{"stamp": 0.5}, {"stamp": 2.0, "x": float("nan")}])
def test_a_goal_that_would_have_replaced_nothing_does_not_so_when_its_cancel_comes_first(setup, details):
    driving = setup.goal()
    setup.relay.take_overtaken(PaperClientGoal("other", **details), 1e6)
    assert driving.state == ACTIVE and setup.server.sent[0].cancels == 0


def test_cancels_of_other_goals_change_nothing(setup):
    old, new = setup.goal(), setup.goal()
    setup.cancel(old)
    setup.relay.take_cancel(old)
    assert new.state == ACTIVE and setup.server.sent[1].cancels == 0


def test_a_cancel_nobody_answers_is_repeated_and_then_given_up(setup):
    goal = setup.goal()
    setup.cancel(goal)
    setup.wait(1.5)
    assert setup.server.sent[0].cancels == 2
    setup.wait(18.0)
    assert goal.state == PREEMPTING, "the robot may brake as yet"
    setup.wait(1.0)
    assert goal.state == PREEMPTED
    assert "did not answer" in setup.observer.ended[-1][1].reason


def test_the_next_goal_waits_for_the_end_of_a_cancelled_one(setup):
    old = setup.goal()
    setup.cancel(old)
    new = setup.goal()
    assert (old.state, new.state) == (PREEMPTED, ACTIVE) and len(setup.server.sent) == 1
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    assert len(setup.server.sent) == 2


def test_but_not_for_ever(setup):
    setup.cancel(setup.goal())
    setup.goal()
    setup.wait(1.0)
    assert len(setup.server.sent) == 1
    setup.wait(1.5)
    assert len(setup.server.sent) == 2


def test_a_third_goal_waits_too(setup):
    setup.cancel(setup.goal())
    second, third = setup.goal(), setup.goal()
    assert (second.state, third.state) == (PREEMPTED, ACTIVE) and len(setup.server.sent) == 1
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    assert len(setup.server.sent) == 2


@pytest.mark.parametrize("quaternion", [
    (0.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0, 0.95), (1e-4, 0.0, 0.0, 0.0), (1e200, 0.0, 0.0, 1e200),
])
def test_a_goal_turned_nowhere_is_aborted_and_what_ran_is_stopped(setup, quaternion):
    running = setup.goal()
    goal = setup.goal(quaternion=quaternion)
    assert (goal.state, goal.text) == (ABORTED, answers.INVALID_QUATERNION)
    assert running.state == PREEMPTED and setup.server.sent[0].cancels == 1 and len(setup.server.sent) == 1


@pytest.mark.parametrize("broken, text", [
    ({"quaternion": (float("nan"), 0.0, 0.0, 1.0)}, answers.INVALID_QUATERNION),
    ({"quaternion": (0.0, float("inf"), 0.0, 1.0)}, answers.INVALID_QUATERNION),
    ({"x": float("nan")}, answers.NO_PLAN), ({"x": -float("inf")}, answers.NO_PLAN),
])
def test_a_goal_that_is_not_finite_is_aborted_and_the_robot_drives_on_where_it_was_sent(setup, broken, text):
    running = setup.goal()
    goal = setup.goal(**broken)
    assert (goal.state, goal.text) == (ABORTED, text) and "not finite" in setup.observer.ended[-1][1].reason
    assert running.state == ACTIVE and setup.server.sent[0].cancels == 0 and len(setup.server.sent) == 1
    setup.cancel(running)
    assert setup.server.sent[0].cancels == 1


def test_a_successor_the_server_refuses_leaves_the_robot_standing(setup):
    setup.goal()
    refused = setup.goal()
    first, second = setup.server.sent
    assert first.cancels == 0, "the server replaces it without stopping the robot"
    second.end(ABORTED, GetPathResult.INVALID_GOAL)
    assert refused.state == ABORTED and first.cancels == 1
    assert setup.observer.stops == 0
    first.end(PREEMPTED, MoveBaseResult.CANCELED)
    assert setup.observer.stops == 1


def test_a_cancel_before_the_server_took_the_successor_stops_the_one_that_drives(setup):
    setup.goal()
    successor = setup.goal()
    setup.cancel(successor)
    assert [sent.cancels for sent in setup.server.sent] == [1, 1]


@pytest.mark.parametrize(
    "ending",
    [
        (SUCCEEDED, MoveBaseResult.SUCCESS),
        (PREEMPTED, MoveBaseResult.CANCELED),
        (ABORTED, ExePathResult.OSCILLATION),
        (LOST, None),
    ],
)
def test_the_robot_is_told_to_stand_when_its_last_goal_ends_and_once_more_in_case_a_velocity_was_on_its_way(
    setup, ending
):
    setup.goal()
    setup.server.sent[0].end(*ending)
    assert setup.observer.stops == 1
    for _ in range(5):
        setup.wait(0.1)
    assert setup.observer.stops == 2
    setup.goal()
    setup.server.sent[1].end(*ending)
    if ending[0] != LOST:
        setup.goal()
        setup.wait(0.1)
        assert setup.observer.stops == 3, "it drives for the next goal by then"


def test_a_replaced_goal_s_end_does_not_stop_the_robot(setup):
    setup.goal(), setup.goal()
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    setup.wait(0.1)
    assert setup.observer.stops == 0


def test_a_server_that_never_answers_a_cancel_has_the_robot_stopped_over_its_head(setup):
    setup.cancel(setup.goal())
    setup.wait(20.1)
    assert setup.observer.stops >= 1


def test_its_cancel_is_repeated_until_the_server_answers(setup):
    setup.goal()
    setup.goal(quaternion=(0.0, 0.0, 0.0, 0.0))
    setup.wait(1.5)
    sent = setup.server.sent[0]
    assert sent.cancels == 2
    sent.end(PREEMPTED, MoveBaseResult.CANCELED)
    setup.wait(10.0)  # a cancel after the end would be refused by the stand-in


@pytest.mark.parametrize("step", [0.1, 25.0])
def test_a_goal_after_a_cancel_nobody_answered_is_not_hit_by_the_last_of_its_repetitions(setup, step):
    """The stand-in for the server refuses a goal that comes right behind a cancel."""
    setup.cancel(setup.goal())
    assert any(setup.wait(step) or setup.observer.stops for _ in range(300)), "it is given up and the robot stopped"
    assert not setup.goal().is_done and len(setup.server.sent) == 2


def test_a_cancel_that_was_given_up_is_not_repeated_for_ever(setup):
    setup.goal()
    setup.goal(quaternion=(0.0, 0.0, 0.0, 0.0))
    setup.wait(25.0)
    given_up = setup.server.sent[0].cancels
    setup.wait(25.0)
    assert setup.server.sent[0].cancels == given_up


def test_a_robot_driven_by_a_goal_that_was_given_up_is_told_to_stand_when_it_ends_at_last(setup):
    setup.cancel(setup.goal())
    setup.wait(25.0)
    setup.wait(0.1)
    stops = setup.observer.stops
    setup.wait(60.0)
    setup.server.sent[0].end(LOST)
    assert setup.observer.stops == stops + 1


def test_a_rounded_quaternion_will_do(setup):
    assert setup.goal(quaternion=(0.0, 0.0, -0.112, 0.999)).state == ACTIVE


def test_a_goal_waits_for_the_server_and_is_sent_when_it_comes(setup):
    setup.server.server_is_up = False
    goal = setup.goal()
    setup.wait(15.0)
    assert goal.state == ACTIVE and not setup.server.sent
    setup.server.server_is_up = True
    setup.wait(0.1)
    assert len(setup.server.sent) == 1
    setup.wait(30.0)
    assert goal.state == ACTIVE


def test_it_does_not_wait_for_ever(setup):
    setup.server.server_is_up = False
    goal = setup.goal()
    setup.wait(20.1)
    assert goal.state == ABORTED and "'move_base_flex' within 20 s" in goal.text


def test_a_goal_cancelled_while_it_waits_is_preempted_at_once(setup):
    setup.server.server_is_up = False
    goal = setup.goal()
    setup.cancel(goal)
    assert goal.state == PREEMPTED
    setup.server.server_is_up = True
    setup.wait(0.1)
    assert not setup.server.sent


def test_a_server_that_dies_aborts_the_goal_and_stops_the_robot(setup):
    goal = setup.goal()
    setup.server.die()
    assert goal.state == ABORTED and "server died" in goal.text and setup.observer.stops == 1


def test_a_server_that_dies_under_a_replaced_goal_stops_the_robot_too(setup):
    setup.cancel(setup.goal())
    waiting = setup.goal()
    setup.server.die()
    assert setup.observer.stops == 1 and waiting.state == ACTIVE


def test_the_next_life_gets_the_next_goal_and_nothing_of_the_old_one(setup):
    setup.goal()
    old = setup.server.sent[0]
    setup.server.die()
    setup.server.server_is_up = True
    goal = setup.goal()
    old.say(99.0)
    old.end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert goal.state == ACTIVE and goal.feedback == []


def test_nothing_is_left_driving_when_a_goal_ends_before_it_was_sent(setup):
    setup.goal()
    setup.server.server_is_up = False
    goal = setup.goal()
    setup.cancel(goal)
    assert goal.state == PREEMPTED and setup.server.sent[0].cancels == 1


def test_shutting_down_cancels_and_says_so(setup):
    goal = setup.goal()
    setup.relay.shut_down()
    assert (goal.state, goal.text) == (ABORTED, answers.NODE_KILLED) and setup.server.sent[0].cancels == 1
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    setup.relay.shut_down()


def test_a_robot_is_sent_nowhere_by_a_relay_that_ends(setup):
    """Nobody would be left to answer for a goal that came while the last words were being sent."""
    setup.relay.shut_down()
    goal = setup.goal()
    assert (goal.state, goal.text) == (ABORTED, answers.NODE_KILLED) and not setup.server.sent


def test_every_goal_is_told_of_once(setup):
    fronts = [setup.goal() for _ in range(20)]
    setup.server.sent[-1].end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert [name for name, *_ in setup.observer.ended] == [goal.get_goal_id().id for goal in fronts]
    assert [answer.status for _, answer, _ in setup.observer.ended] == [PREEMPTED] * 19 + [SUCCEEDED]


def test_an_answer_that_comes_before_send_returns_is_taken(setup):
    real = setup.server.send

    def send_and_hear(goal, on_feedback, on_end):
        back = real(goal, on_feedback, on_end)
        back.end(SUCCEEDED, MoveBaseResult.SUCCESS)
        return back

    setup.server.send = send_and_hear
    assert setup.goal().state == SUCCEEDED
    assert setup.goal().state == SUCCEEDED


def test_a_lost_goal_keeps_its_reason_in_the_text(setup):
    goal = setup.goal()
    setup.server.sent[0].end(LOST, text="action server /mbf/move_base was restarted or dropped the goal")
    assert goal.text == "Action server /mbf/move_base was restarted or dropped the goal"


def test_who_does_not_wait_for_a_server_waits_for_one_that_is_there():
    """By server_timeout: 0 a goal was aborted for want of a server that was still ending the one before it."""
    setup = Setup(server_timeout=0.0)
    setup.cancel(setup.goal())
    goal = setup.goal()
    setup.wait(0.1)
    assert goal.state == ACTIVE
    setup.server.sent[0].end(PREEMPTED, MoveBaseResult.CANCELED)
    setup.server.sent[1].end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert goal.state == SUCCEEDED
    setup.server.die()
    goal = setup.goal()
    setup.wait(0.1)
    assert goal.state == ABORTED
