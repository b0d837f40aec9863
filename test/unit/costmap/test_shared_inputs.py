"""Layers of one costmap that see by the same sensor, and those that only call theirs alike."""

import numpy as np
import pytest
from test_layers import STILL, cost_at

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY


@pytest.mark.parametrize("rear, names", [
    ({"data_type": "LaserScan", "topic": "rear"}, ["scan", "second/scan"]),
    ({"data_type": "PointCloud2", "topic": "front"}, ["scan", "second/scan"]),
    ({"data_type": "LaserScan", "topic": "front", "inf_is_valid": False}, ["scan", "second/scan"]),
    ({"data_type": "LaserScan", "topic": "front", "sensor_frame": "laser"}, ["scan", "second/scan"]),
    ({"data_type": "LaserScan", "topic": "front", "observation_persistence": 2.0}, ["scan", "second/scan"]),
    ({"data_type": "LaserScan", "topic": "front"}, ["scan"]),
    ({"data_type": "LaserScan", "topic": "front", "obstacle_range": 2.0}, ["scan"]),
])
def test_two_layers_that_give_their_sensors_one_name_see_by_both(rear, names):
    """The second layer's sensor was never listened to: what the first one's saw was put in its place.

    Nor did it read by its own `inf_is_valid`: what it had once marked in the open stayed for ever.
    """
    layers = {"first": {"data_type": "LaserScan", "topic": "front"}, "second": rear}
    costmap = factory.build_costmap("costmap", {
        **STILL, "plugins": [{"name": name, "type": "costmap_2d::ObstacleLayer"} for name in layers],
        **{name: {"observation_sources": "scan", "scan": source} for name, source in layers.items()}})
    assert list(costmap.sources) == names and costmap.sources[names[-1]].topic == rear["topic"]
    for distance, name in zip((0.5, 1.0), names):
        costmap.observe(name, Observation((0.0, 0.0), np.array([[distance, 0.0]] * 2), None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert [cost_at(costmap, x, 0.0) == LETHAL for x in (0.5, 1.0)] == [True, len(names) == 2]
    assert costmap.stale_reason(0.1) is None
    costmap.refuse(names[-1], "all beams are 0")
    reasons = [layer.stale_reason(0.1) for layer in costmap.layers]
    assert [reason is None for reason in reasons] == [len(names) == 2, False]
