"""Which maps a costmap's node waits for before the robot may drive, and what it says while it waits."""

from unittest import mock

import pytest
from scan_source import StillFrames

from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.costmap import inputs, node, publisher


@pytest.fixture(autouse=True)
def no_graph(monkeypatch):
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(publisher.rospy, "Publisher", mock.MagicMock())
    monkeypatch.setattr(node.rospy, "get_time", lambda: 1.0)


def make(frames=StillFrames, **layer):
    """Return the node of a costmap of one layer."""
    group = {"update_frequency": 5.0, "global_frame": "map", "plugins": [{"name": "floor", "type": layer.pop("type")}]}
    return node.CostmapNode("global_costmap", {"global_costmap": {**group, "floor": layer}}, frames())


@pytest.mark.parametrize("kind", ["costmap_2d::StaticLayer", "nav2_costmap_2d::KeepoutFilter"])
def test_a_robot_does_not_wait_for_the_map_of_a_layer_that_is_switched_off(kind):
    """move_base took no goals until somebody published the map that its costmap leaves out."""
    made = {enabled: make(type=kind, enabled=enabled) for enabled in (True, False)}
    for each in made.values():
        each.costmap.update(1.0, IDENTITY)
    assert "has come on topic" in made[True].missing_input()
    assert made[False].missing_input() == ""
