"""Goals by an id that one had before, which are not taken."""

import pytest
from tracked_goals import Server

from mbf_relay.ros.common.actions import goal_lease
from mbf_relay.ros.common.actions.goal_tracker import LIST_FOR


@pytest.mark.parametrize("seconds", [1.0, LIST_FOR + 1.0])
def test_who_sends_each_goal_by_one_id_is_told_why_the_robot_stands(caplog, seconds):
    """A script with the id "1" drove once, and then not for a minute, without a word."""
    server = Server()
    first = server.goal("1")
    server.goal("1")
    assert not caplog.records, "a goal that comes twice while it is pursued is one"
    first.set_rejected()
    server.wait(seconds)
    for _ in range(3):
        server.goal("1")
    assert server.taken == [first]
    (said,) = [record.getMessage() for record in caplog.records if "the id '1'" in record.getMessage()]
    assert f"ended {seconds:.0f} s ago" in said


@pytest.mark.parametrize("seconds", [0.0, LIST_FOR + 1.0])
def test_nobody_is_warned_of_a_goal_that_its_client_sent_again_before_it_heard_of_its_end(caplog, seconds):
    server, name = Server(), "goal" + goal_lease.MARK
    server.goal(name).set_rejected()
    server.wait(seconds)
    server.goal(name)
    assert not caplog.records
