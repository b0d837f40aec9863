"""A client's goals: leases, what an earlier life left, and what is lost."""

import gc
import weakref

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from genpy import Time
from move_base_msgs.msg import (
    MoveBaseActionFeedback,
    MoveBaseActionGoal,
    MoveBaseActionResult,
    MoveBaseGoal,
)

from mbf_relay.ros.common.actions.client_goals import RESEND_AFTER, ClientGoals
from mbf_relay.ros.relay.relay import RelayParameters


class Links:
    """The way to a server, with what was sent on it."""

    def __init__(self, takes_leases=True):
        self.takes_leases, self.goals, self.cancels, self.renewed, self.now = takes_leases, [], [], [], 100.0
        self.publish_goal = self.goals.append

    def publish_cancel(self, goal_id):
        self.cancels.append(goal_id.id)

    def renew(self, goal_id):
        self.renewed.append(goal_id.id)


def make(links, life="00000002", acknowledge_timeout=10.0):
    return ClientGoals(
        "/server/drive",
        "/relay",
        MoveBaseActionGoal,
        links,
        acknowledge_timeout,
        lambda: links.now,
        lambda: Time.from_sec(links.now),
        life=life,
    )


def status(*pairs):
    return GoalStatusArray(status_list=[GoalStatus(goal_id=GoalID(id=name), status=state) for name, state in pairs])


def test_a_goal_is_renewed_until_it_is_cancelled():
    links = Links()
    goals = make(links)
    sent = goals.send(MoveBaseGoal())
    goals.check()
    assert links.renewed == [sent.goal_id] and sent.goal_id.endswith("+lease")
    sent.cancel()
    goals.check()
    assert links.renewed == [sent.goal_id] and links.cancels == [sent.goal_id]


def test_a_server_that_knows_of_no_leases_gets_goals_as_actionlib_s_clients_send_them():
    links = Links(takes_leases=False)
    goals = make(links)
    assert "+" not in goals.send(MoveBaseGoal()).goal_id
    goals.check()
    assert links.renewed == []


def test_what_a_relay_made_for_a_goal_goes_with_the_goal():
    """Each goal and its errand kept each other, until a collection that comes once in thousands of goals."""
    class Errand:
        goal = None

        def take(self, _ending):
            pass

    goals = make(Links())
    gc.disable()
    try:
        errand = Errand()
        errand.goal = goals.send(MoveBaseGoal(), on_feedback=errand.take, on_end=errand.take)
        name, left = errand.goal.goal_id, weakref.ref(errand)
        goals.take_result(MoveBaseActionResult(status=GoalStatus(goal_id=GoalID(id=name), status=GoalStatus.SUCCEEDED)))
        del errand
        assert left() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("mark", ["", "+lease"])
def test_what_an_earlier_life_of_the_node_left_driving_is_called_back(mark):
    links = Links()
    goals = make(links)
    mine = goals.send(MoveBaseGoal())
    left = f"/relay-00000001-7{mark}"
    goals.take_status(status(
        (left, GoalStatus.ACTIVE), (f"/relay-00000001-6{mark}", GoalStatus.ABORTED), (mine.goal_id, GoalStatus.ACTIVE),
        ("/relay2-00000001-5", GoalStatus.ACTIVE), ("/relay-1-1604.25", GoalStatus.ACTIVE)))
    assert links.cancels == [left]


def test_a_goal_is_sent_again_until_it_is_heard_of_and_lost_where_it_never_is():
    links = Links()
    goals, endings = make(links), []
    sent = goals.send(MoveBaseGoal(), on_end=endings.append)
    for _ in range(120):
        links.now += 0.1
        goals.check()
    assert len(links.goals) > 5 and [ending.status for ending in endings] == [GoalStatus.LOST]
    assert links.cancels == [sent.goal_id], "a server that only was slow must not go on with what was given up"


@pytest.mark.parametrize("state", [GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.PREEMPTED])
def test_a_robot_whose_goal_is_said_to_have_ended_is_not_left_driving_for_it(state):
    """A result in the server's name answered the client, and the robot drove on until the goal's lease ran out."""
    links = Links()
    goals = make(links)
    sent = goals.send(MoveBaseGoal())
    goals.take_result(MoveBaseActionResult(status=GoalStatus(goal_id=GoalID(id=sent.goal_id), status=state)))
    assert sent.ending.status == state and links.cancels == [sent.goal_id]


def test_a_goal_that_was_called_off_is_not_sent_again_before_its_cancel_is_known():
    links = Links()
    goals, endings = make(links), []
    sent = goals.send(MoveBaseGoal(), on_end=endings.append)
    sent.cancel()
    for _ in range(30):
        links.now += 0.1
        goals.check()
    assert len(links.goals) == 1 and len(links.cancels) >= 3
    for _ in range(30):  # the server got the cancel, and waits for the goal to end it
        links.now += 0.1
        goals.take_status(status((sent.goal_id, GoalStatus.RECALLING)))
    assert 2 <= len(links.goals) <= 4
    ended = GoalStatus(goal_id=GoalID(id=sent.goal_id), status=GoalStatus.RECALLED)
    goals.take_result(MoveBaseActionResult(status=ended))
    assert [ending.status for ending in endings] == [GoalStatus.RECALLED]


def test_an_end_comes_once_whatever_arrives_twice_or_not_at_all():
    links = Links()
    goals, endings = make(links), []
    sent = goals.send(MoveBaseGoal(), on_end=endings.append)
    result = MoveBaseActionResult(status=GoalStatus(goal_id=GoalID(id=sent.goal_id), status=GoalStatus.SUCCEEDED))
    goals.take_result(result), goals.take_result(result)
    other = goals.send(MoveBaseGoal(), on_end=endings.append)
    goals.take_status(status((other.goal_id, GoalStatus.ABORTED)))
    links.now += 3.0
    goals.check()
    assert [ending.status for ending in endings] == [
        GoalStatus.SUCCEEDED,
        GoalStatus.ABORTED,
    ] and goals.open_goals == []


@pytest.mark.parametrize("server_timeout", [0.0, 0.5, 20.0])
def test_a_server_that_is_there_is_given_time_to_tell_of_a_goal_however_short_an_absent_one_is_waited_for(
    server_timeout
):
    """By server_timeout: 0 the next look, a tenth of a second after the goal had left, took it for lost."""
    links = Links()
    goals = make(links, acknowledge_timeout=RelayParameters(server_timeout=server_timeout).acknowledge_timeout)
    sent = goals.send(MoveBaseGoal())
    links.now += RESEND_AFTER + 0.1
    goals.check()
    assert sent.ending is None and len(links.goals) == 2
    for _ in range(10):
        goals.take_status(status((sent.goal_id, GoalStatus.ACTIVE)))
        links.now += 10.0
        goals.check()
    assert sent.ending is None and len(links.goals) == 2, "sent on and on, though it is carried out"


def test_who_waits_for_a_server_that_was_restarted_and_knows_of_no_goal_is_told():
    """The robot stood, and the goal was running for ever."""
    links = Links()
    goals, endings = make(links), []
    ended, running, young = (goals.send(MoveBaseGoal(), on_end=endings.append) for _ in range(3))
    goals.take_status(status((ended.goal_id, GoalStatus.SUCCEEDED), (running.goal_id, GoalStatus.ACTIVE)))
    links.now += 1.0
    goals.take_status(status((ended.goal_id, GoalStatus.SUCCEEDED)))
    goals.take_status(status())
    assert running.ending.status == GoalStatus.LOST and "restarted" in running.ending.text
    assert ended.ending is None and young.ending is None, "its result is on its way; it has not been heard of"
    links.now += 1.5
    goals.check()
    assert ended.ending.status == GoalStatus.SUCCEEDED, "two seconds after it was said to have ended"


def test_goals_of_a_server_that_is_gone_are_lost_each_once_but_for_one_whose_result_comes_meanwhile():
    links = Links()
    goals, endings = make(links), []

    def take_last_result(_ending):
        goals.take_result(MoveBaseActionResult(
            status=GoalStatus(goal_id=GoalID(id=second.goal_id), status=GoalStatus.SUCCEEDED)))

    first = goals.send(MoveBaseGoal(), on_end=take_last_result)
    second = goals.send(MoveBaseGoal(), on_end=endings.append)
    third = goals.send(MoveBaseGoal())
    goals.check("its process has ended")
    assert [ending.status for ending in endings] == [GoalStatus.SUCCEEDED]
    assert second.ending.status == GoalStatus.SUCCEEDED
    assert first.ending == third.ending == (GoalStatus.LOST, "its process has ended", None)
    assert goals.open_goals == []


def test_feedback_is_given_to_whoever_sent_the_goal_until_it_has_ended():
    links = Links()
    goals, told = make(links), []
    sent = goals.send(MoveBaseGoal(), on_feedback=told.append)
    quiet = goals.send(MoveBaseGoal())
    assert goals.knows(sent.goal_id) and not goals.knows("/another-00000001-1")
    for goal_id in ("/another-00000001-1", quiet.goal_id, sent.goal_id):
        goals.take_feedback(MoveBaseActionFeedback(status=GoalStatus(goal_id=GoalID(id=goal_id))))
    goals.check("its process has ended")
    goals.take_feedback(MoveBaseActionFeedback(status=GoalStatus(goal_id=GoalID(id=sent.goal_id))))
    assert len(told) == 1


def test_what_a_node_that_ends_has_sent_is_called_off():
    links = Links()
    goals = make(links)
    first, second = goals.send(MoveBaseGoal()), goals.send(MoveBaseGoal())
    goals.take_result(MoveBaseActionResult(
        status=GoalStatus(goal_id=GoalID(id=first.goal_id), status=GoalStatus.SUCCEEDED)))
    links.cancels.clear()
    goals.cancel_all()
    assert links.cancels == [second.goal_id]


def test_a_goal_is_dated_so_that_its_server_can_tell_which_of_two_is_the_newer_one():
    links = Links()
    goals = make(links)
    for _ in range(2):
        goals.send(MoveBaseGoal())
        links.now += 1.0
    assert [message.goal_id.stamp.to_sec() for message in links.goals] == [100.0, 101.0]
    assert [message.header.stamp.to_sec() for message in links.goals] == [100.0, 101.0]


def test_who_waits_for_a_robot_hears_how_its_goal_ended_and_waits_neither_past_its_time_nor_past_the_node_s_end():
    links, kept_up = Links(), []
    goals = make(links)

    def keep_up():
        kept_up.append(True)
        if len(kept_up) == 3:
            goals.take_status(status((sent.goal_id, GoalStatus.ACTIVE)))
            goals.take_result(MoveBaseActionResult(status=GoalStatus(
                goal_id=GoalID(id=sent.goal_id), status=GoalStatus.SUCCEEDED, text="there")))
        return True

    sent = goals.send(MoveBaseGoal())
    assert sent.wait() is None, "of a node that ends"
    goals.keep_up = lambda: True
    assert sent.wait(0.0) is None
    goals.keep_up = keep_up
    ending = sent.wait(10.0)
    assert (ending.status, ending.text) == (GoalStatus.SUCCEEDED, "there") and len(kept_up) == 3
    assert sent.wait() is ending
