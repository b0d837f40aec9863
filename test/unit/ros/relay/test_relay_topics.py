"""What a dashboard that listens to move_base's topics goes on receiving when another one opens."""

from types import SimpleNamespace
from unittest import mock

import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid

from mbf_relay.ros.relay import topics


@pytest.fixture
def subscriptions(monkeypatch):
    """The subscriptions made, each with whether it has ended."""
    made = []

    def subscribe(topic, *_args, **_values):
        one = SimpleNamespace(topic=topic, ended=False)
        one.unregister = lambda: setattr(one, "ended", True)
        made.append(one)
        return one

    monkeypatch.setattr(topics.rospy, "Subscriber", subscribe)
    monkeypatch.setattr(topics.rospy, "Publisher", mock.MagicMock())
    return made


@pytest.mark.parametrize("message, ended", [(OccupancyGridUpdate, [False]), (OccupancyGrid, [True, False])])
def test_a_second_map_display_takes_no_change_of_a_costmap_from_the_first(subscriptions, message, ended):
    """What changed while the relay subscribed anew stayed on the first one's screen as it had been."""
    topic = topics.LazyTopic("~costmap", message, lambda: "server/costmap")
    for name in ("/rviz", "/dashboard"):
        topic.peer_subscribe(name, None, None)
    assert [each.ended for each in subscriptions] == ended  # the whole is sent to new subscribers alone
    topic.peer_unsubscribe("/rviz", 1)
    assert not subscriptions[-1].ended
    topic.peer_unsubscribe("/dashboard", 0)
    assert all(each.ended for each in subscriptions)
    topic.peer_subscribe("/rviz", None, None)
    assert not subscriptions[-1].ended
