"""Who begins to listen to a costmap gets all of it."""

import numpy as np
from scan_source import StillFrames, scan_source

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OccupancyMap
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


class _Topic:
    """A publisher to which somebody listens, and what it sent."""

    def __init__(self):
        self.sent = []
        self.publish = self.sent.append

    @staticmethod
    def get_num_connections():
        return 1


def test_who_begins_to_listen_while_a_costmap_is_published_misses_no_change(monkeypatch):
    """RViz kept an obstacle out of sight that was published while the large map was on its way to it."""
    topics = {}

    def advertise(topic, _message, subscriber_listener=None, **_):
        topics[topic.rsplit("/", 1)[1]] = made = _Topic()
        made.greeter = subscriber_listener
        return made

    monkeypatch.setattr(publisher.rospy, "Publisher", advertise)
    costmap = build_costmap("c", {
        "plugins": [{"name": "s", "type": "StaticLayer"}], "s": {"subscribe_to_updates": True}})
    costmap.set_map(OccupancyMap(np.zeros((20, 30), np.int8), 0.05, Pose2D(0.0, 0.0, 0.0)))
    served = publisher.CostmapPublisher("c", "footprint", False, costmap.snapshot)

    def publish(now, column=None):
        if column is not None:
            costmap.update_map(column, 4, np.full((1, 1), 100, np.int8))
        costmap.update(now, IDENTITY)
        served.publish(costmap.snapshot())

    publish(1.0)
    shown = []

    def slow(message):
        publish(2.0, column=3)
        topics["costmap_updates"].sent.clear()  # it was for who had the map
        shown.append(np.array(message.data, np.int8).reshape(20, 30))

    topics["costmap"].greeter.peer_subscribe("costmap", None, slow)
    publish(3.0, column=7)
    [update] = topics["costmap_updates"].sent
    part = np.array(update.data, np.int8).reshape(update.height, update.width)
    shown[0][update.y:update.y + update.height, update.x:update.x + update.width] = part
    assert np.argwhere(shown[0] == 100).tolist() == [[4, 3], [4, 7]]
    publish(4.0, column=9)
    assert [(one.x, one.width) for one in topics["costmap_updates"].sent] == [(3, 5), (9, 1)], "and no more than needed"
