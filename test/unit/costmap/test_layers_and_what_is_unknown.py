"""What layers make of what a map, or a sensor's clock, does not tell."""

import numpy as np
import pytest
from test_layers import STILL, cost_at, with_obstacles

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL, NO_INFORMATION
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OccupancyMap


@pytest.mark.parametrize("rolling", [False, True])
def test_an_obstacle_is_not_lost_under_a_part_of_the_map_that_nobody_knows(rolling):
    obstacles = {"observation_sources": "scan", "scan": {"data_type": "LaserScan"}, "footprint_clearing_enabled": False}
    costmap = factory.build_costmap("costmap", {
        **STILL, "rolling_window": rolling, "track_unknown_space": True, "obstacles": obstacles,
        "static": {"use_maximum": True}, "plugins": [
            {"name": "obstacles", "type": "costmap_2d::ObstacleLayer"},
            {"name": "static", "type": "costmap_2d::StaticLayer"}]})
    data = np.zeros((40, 40), np.int8)
    data[:, 20:] = -1
    costmap.set_map(OccupancyMap(data, 0.1, Pose2D(-2.0, -2.0, 0.0)))
    points = np.array([[0.55, 0.05], [-0.55, 0.05]])
    costmap.observe("scan", Observation((0.05, 0.05), points, None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert [cost_at(costmap, x, 0.05) for x in (0.55, -0.55, 1.05, -1.05)] == [
        LETHAL, LETHAL, NO_INFORMATION, FREE_SPACE]


def test_what_a_sensor_without_a_clock_sees_persists_from_when_it_came():
    costmap = with_obstacles({"clearing": False, "observation_persistence": 1.0, "data_type": "PointCloud2"})
    for step in range(4):
        point = np.array([[0.3 + 0.3 * step, 0.0]])
        costmap.observe("scan", Observation((0.0, 0.0), point, None, 0.0), 100.0 + 0.5 * step)
    costmap.update(101.5, IDENTITY)
    assert (costmap.snapshot().costs == LETHAL).sum() == 3
