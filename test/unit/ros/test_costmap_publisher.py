"""Who begins to listen to a costmap gets all of it."""

from scan_source import StillFrames, scan_source

from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.costmap import inputs, node, publisher


def test_whoever_looks_at_a_costmap_that_is_published_at_no_rate_sees_it_as_it_is(monkeypatch):
    """RViz showed nothing, and who waits for one message waited for ever; costmap_2d's default is no rate."""
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    listeners, got = [], []

    def advertise(_topic, _message, subscriber_listener=None, **_):
        listeners.append(subscriber_listener)

    monkeypatch.setattr(publisher.rospy, "Publisher", advertise)
    costmap, _ = scan_source(StillFrames(), patience=0.2)
    assert costmap.parameters.publish_frequency == 0.0
    made = node.CostmapNode("local_costmap", {"local_costmap": {}}, StillFrames())
    made.costmap = costmap
    [greeter] = filter(None, listeners)
    greeter.peer_subscribe("costmap", None, got.append)
    assert got == []
    for now in (1.0, 2.0):
        costmap.update(now, IDENTITY)
        greeter.peer_subscribe("costmap", None, got.append)
    assert [message.header.stamp.to_sec() for message in got] == [1.0, 2.0]
    assert (got[0].info.width, got[0].info.height) == (40, 40)
