"""The client's topics: when a goal may be sent, and whose word of it counts."""

from types import SimpleNamespace

import pytest
import rospy
from actionlib_msgs.msg import GoalID

from mbf_relay.ros.common.actions.action_client import ActionClient

LINKS = ("result", "feedback", "goal", "cancel")


class Link:
    """A topic with a number of connections."""

    def __init__(self, connections):
        self.connections, self.published, self.is_open = connections, [], True

    def get_num_connections(self):
        return self.connections

    def publish(self, message):
        self.published.append(message)

    def unregister(self):
        self.is_open = False


def client(missing="", lease=None, **watch):
    """Return a client of a server that is there, but for one of the topics."""
    made = ActionClient.__new__(ActionClient)
    result, feedback, made._goal_publisher, made._cancel_publisher = (Link(int(name != missing)) for name in LINKS)
    made.name, made._subscribers, made._lease_publisher = "/move_base_flex/move_base", [result, feedback], lease
    made._watch = SimpleNamespace(**{"is_up": True, "is_connected": True, "loss": "", **watch})
    return made


@pytest.mark.parametrize("missing", LINKS)
def test_no_goal_is_sent_that_could_not_be_called_off_or_whose_end_would_not_be_heard(missing):
    assert client().server_is_up and not client(missing).server_is_up


@pytest.mark.parametrize("watch", [{"is_up": False}, {"is_connected": False}])
def test_no_goal_is_sent_to_a_server_that_is_gone(watch):
    assert not client(**watch).server_is_up


def test_it_is_told_how_a_server_was_lost_and_where_none_ever_was():
    assert client(is_up=False, loss="died: its node closed the connection").why_down.startswith("died")
    assert "/move_base_flex/move_base is not there" in client(is_up=False).why_down
    assert "is not there" in client("goal", loss="died once").why_down, "it is back, and not connected yet"


def test_a_goal_ends_with_its_client_where_the_server_listens_for_that():
    listened_to, ignored = Link(1), Link(0)
    assert client(lease=listened_to).takes_leases
    assert not client(lease=ignored).takes_leases and not client().takes_leases
    client(lease=listened_to).renew(GoalID(id="one"))
    client().renew(GoalID(id="two"))
    assert [each.id for each in listened_to.published] == ["one"]


def test_a_stranger_s_word_of_a_goal_counts_nothing_and_of_others_goals_none_does(monkeypatch):
    heard, said = [], []
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda period, text: said.append(text.split()[0]))
    made = client(is_from_server=lambda message: message._connection_header["callerid"] == "/server")
    made._goals = SimpleNamespace(knows=lambda goal_id: goal_id == "own")
    for goal_id, node in (("own", "/server"), ("own", "/stranger"), ("other", "/server"), ("other", "/stranger")):
        status = SimpleNamespace(goal_id=GoalID(id=goal_id))
        message = SimpleNamespace(status=status, _connection_header={"callerid": node})
        made._take_from_server(message, lambda one: heard.append(one.status.goal_id.id))
    assert heard == ["own"] and said == ["/stranger"]


def test_goals_learn_of_a_server_s_loss_and_a_client_that_is_closed_holds_no_topic():
    lost, lease = [], Link(1)
    made = client(lease=lease, why_lost=lambda now: "died", close=lambda: lost.append("closed"))
    made._goals = SimpleNamespace(check=lost.append)
    made.check()
    made.close()
    assert lost == ["died", "closed"]
    links = (*made._subscribers, made._goal_publisher, made._cancel_publisher, lease)
    assert not any(link.is_open for link in links)
