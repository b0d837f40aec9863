"""Topics of the server that the relay passes on while somebody listens."""

import threading
from types import SimpleNamespace

import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from ros_testing import wait_until

from mbf_relay.ros.relay import topics

TOPICS = pytest.mark.parametrize("make, sources", [
    (lambda: topics.LazyTopic("~global_costmap/costmap", OccupancyGrid, lambda: "costmap"), ["costmap"]),
    (lambda: topics.RecoveryTopic("server", None), ["server/recovery_status", "server/recovery/goal"]),
], ids=["costmap", "recoveries"])


@pytest.fixture
def graph(monkeypatch):
    """Return what the relay listens to, how often it began to, and how many listen to the relay."""
    graph = SimpleNamespace(sources=[], begun=0, listeners=0)

    class Subscriber:
        def __init__(self, name, *_rest, **_options):
            self.name = name
            graph.begun += 1
            graph.sources.append(name)

        def unregister(self):
            graph.sources.remove(self.name)

    monkeypatch.setattr(topics.rospy, "Subscriber", Subscriber)

    def advertise(*_rest, subscriber_listener, **_options):
        if graph.listeners:  # as where they listened to a relay that has died
            early = threading.Thread(target=subscriber_listener.peer_subscribe, args=("", None, None))
            early.start()
            early.join(0.2)  # where it waits, it goes on when the topic is there
        return SimpleNamespace(publish=None, get_num_connections=lambda: graph.listeners)

    monkeypatch.setattr(topics.rospy, "Publisher", advertise)
    return graph


@TOPICS
def test_rviz_that_is_reset_is_shown_costmaps_again(graph, make, sources):
    """rospy counts who is left before it tells: whoever came in between saw nothing for good."""
    topic = make()
    graph.listeners = 1
    topic.peer_subscribe("", None, None)
    topic.peer_subscribe("", None, None)  # after a reset
    topic.peer_unsubscribe("", 0)  # of the one before, counted before the second came
    assert graph.sources == sources
    graph.listeners = 0
    topic.peer_unsubscribe("", 0)
    assert graph.sources == []


@pytest.mark.parametrize("message, begun", [(OccupancyGridUpdate, 1), (OccupancyGrid, 2)])
def test_a_second_map_display_takes_no_change_of_a_costmap_from_the_first(graph, message, begun):
    """What changed while the relay subscribed anew stayed on the first one's screen as it had been."""
    topic = topics.LazyTopic("~costmap", message, lambda: "server/costmap")
    for graph.listeners in (1, 2):
        topic.peer_subscribe("", None, None)
    assert graph.begun == begun, "the whole is sent to new subscribers alone"
    for graph.listeners, sources in ((1, ["server/costmap"]), (0, [])):
        topic.peer_unsubscribe("", graph.listeners)
        assert graph.sources == sources
    topic.peer_subscribe("", None, None)
    assert graph.sources == ["server/costmap"]


@TOPICS
def test_who_listened_to_a_relay_that_died_is_shown_what_the_next_one_passes_on(graph, make, sources):
    """It connects before the topic is advertised in full."""
    graph.listeners = 1
    topic = make()
    wait_until(lambda: graph.sources == sources, f"{sources} to be listened to")
    topic.peer_unsubscribe("", 0)
    assert graph.sources == sources
