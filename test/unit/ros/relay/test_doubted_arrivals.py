"""Arrivals that the server claims and the relay does not believe."""

import pytest
from fake_server import ABORTED, ACTIVE, PREEMPTED, SUCCEEDED, Setup
from mbf_msgs.msg import MoveBaseResult

from mbf_relay.ros.relay import answers


@pytest.fixture
def setup():
    return Setup()


def arrive(sent, where, distance=0.02):
    result = MoveBaseResult(outcome=MoveBaseResult.SUCCESS, dist_to_goal=distance)
    result.final_pose.header.frame_id, result.final_pose.pose.position.x = "map", where
    sent.end_with(SUCCEEDED, result)


def test_a_robot_credited_with_the_arrival_of_the_goal_before_is_sent_again_and_arrives(setup):
    goal = setup.goal(x=5.0)
    arrive(setup.server.sent[0], where=1.0)
    assert goal.state == ACTIVE and len(setup.server.sent) == 2
    arrive(setup.server.sent[1], where=4.9)
    assert goal.state == SUCCEEDED


@pytest.mark.parametrize("where, distance", [(1.0, 0.02), (5.0, 3.0)])
def test_nobody_is_told_to_have_arrived_whose_robot_stands_elsewhere(setup, where, distance):
    goal = setup.goal(x=5.0)
    for _ in range(2):
        arrive(setup.server.sent[-1], where, distance)
    assert (goal.state, goal.text) == (ABORTED, answers.NO_CONTROL)
    _, answer, result = setup.observer.ended[-1]
    assert "m from the goal; arrival_tolerance is 0.5 m" in answer.reason and len(setup.server.sent) == 2
    assert result is None, "or ~navigation_outcome would go on telling of success"


def test_a_robot_that_is_sent_again_after_a_long_drive_has_a_server_s_whole_patience_for_that(setup):
    goal = setup.goal(x=5.0)
    setup.wait(60.0)
    setup.server.server_is_up = False  # for a moment
    arrive(setup.server.sent[0], where=1.0)
    setup.wait(0.1)
    assert goal.state == ACTIVE, goal.text
    setup.server.server_is_up = True
    setup.wait(0.1)
    arrive(setup.server.sent[1], where=4.9)
    assert goal.state == SUCCEEDED


def test_a_client_that_called_its_robot_back_is_answered_at_once_though_its_server_claims_an_arrival_elsewhere(setup):
    goal = setup.goal(x=5.0)
    setup.cancel(goal)
    arrive(setup.server.sent[0], where=1.0)
    assert goal.state == PREEMPTED and len(setup.server.sent) == 1, "or it waits for a cancel nobody is to answer"
    assert setup.observer.stops == 1
