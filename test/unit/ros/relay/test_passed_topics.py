"""Topics of the server that the relay passes on while somebody listens."""

from types import SimpleNamespace

import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid

from mbf_relay.ros.relay import topics


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
    monkeypatch.setattr(topics.rospy, "Publisher", lambda *_rest, **_options: SimpleNamespace(
        publish=None, get_num_connections=lambda: graph.listeners))
    return graph


@pytest.mark.parametrize("make, sources", [
    (lambda: topics.LazyTopic("~global_costmap/costmap", OccupancyGrid, lambda: "costmap"), ["costmap"]),
    (lambda: topics.RecoveryTopic("server", None), ["server/recovery_status", "server/recovery/goal"]),
], ids=["costmap", "recoveries"])
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
