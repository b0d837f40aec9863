"""Zones: what a mask says of where not to go and how fast, in costmaps that lie still, roll, and have other cells."""

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION
from mbf_relay.costmap.costmap_filter import keepout_costs
from mbf_relay.costmap.factory import build_costmap, unknown_names
from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap

HERE = Pose2D(0.0, 0.0, 0.0)


def floor(side=60, resolution=0.1):
    return OccupancyMap(np.zeros((side, side), np.int8), resolution, Pose2D(-3.0, -3.0, 0.0))


def mask(value, resolution=0.2, origin=Pose2D(-1.0, -1.0, 0.0)):
    """A square of 2 m round (0, 0), whose right half has a value."""
    data = np.zeros((10, 10), np.int8)
    data[:, 5:] = value
    return OccupancyMap(data, resolution, origin)


def global_costmap(kind, **group):
    return build_costmap("global_costmap", {
        "plugins": [{"name": "static", "type": "costmap_2d::StaticLayer"},
                    {"name": "zones", "type": f"nav2_costmap_2d::{kind}"},
                    {"name": "inflation", "type": "costmap_2d::InflationLayer"}],
        "zones": group, "inflation": {"inflation_radius": 0.3},
        "footprint": [[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]]})


def cost_at(costmap, x, y):
    snapshot = costmap.snapshot()
    column, row = snapshot.grid.cell_at(x, y)
    return snapshot.costs[row, column]


def test_a_zone_is_lethal_and_inflated_and_the_floor_stays_free():
    costmap = global_costmap("KeepoutFilter", filter_mask_topic="keepout")
    costmap.set_map(floor(), "static")
    costmap.set_map(mask(100), "zones")
    costmap.update(1.0, HERE)
    assert cost_at(costmap, 0.55, 0.55) == cost_at(costmap, 0.55, -0.95) == LETHAL
    assert cost_at(costmap, -0.55, 0.55) == 0
    assert 0 < cost_at(costmap, -0.15, 0.05) < LETHAL, "inflated"
    assert cost_at(costmap, 2.5, 2.5) == 0, "beside the mask"
    assert costmap.snapshot().costs.shape == (60, 60), "the size is the floor's, whichever map comes last"


@pytest.mark.parametrize("first, then", [("static", "zones"), ("zones", "static")])
def test_two_maps_do_not_take_each_other_s_place(first, then):
    costmap = global_costmap("KeepoutFilter")
    maps = {"static": floor(), "zones": mask(100)}
    for name in (first, then):
        costmap.set_map(maps[name], name)
        costmap.update(1.0, HERE)
    assert cost_at(costmap, 0.55, 0.55) == LETHAL and cost_at(costmap, -0.55, -0.55) == 0


def test_a_second_static_layer_reads_its_own_topic_and_its_own_cells():
    costmap = build_costmap("global_costmap", {
        "plugins": [{"name": "static", "type": "costmap_2d::StaticLayer"},
                    {"name": "keepout", "type": "costmap_2d::StaticLayer"}],
        "keepout": {"map_topic": "map_keepout", "use_maximum": True}})
    assert [layer.map_source.topic for layer in costmap.layers] == ["map", "map_keepout"]
    costmap.set_map(floor(), "static")
    costmap.set_map(mask(100), "keepout")
    costmap.update(1.0, HERE)
    assert cost_at(costmap, 0.55, 0.55) == LETHAL and cost_at(costmap, -2.0, 0.0) == 0
    assert costmap.snapshot().costs.shape == (60, 60)


def test_a_window_that_rolls_in_odometry_s_frame_has_the_zone_where_the_map_has_it():
    costmap = build_costmap("local_costmap", {
        "global_frame": "odom", "rolling_window": True, "width": 4.0, "height": 4.0, "resolution": 0.05,
        "plugins": [{"name": "zones", "type": "nav2_costmap_2d::KeepoutFilter"}]})
    costmap.set_map(mask(100), "zones")
    costmap.set_map_from_costmap(Pose2D(0.0, 0.0, np.pi / 2.0), "zones")
    costmap.update(1.0, HERE)
    assert cost_at(costmap, 0.5, -0.5) == LETHAL and cost_at(costmap, 0.5, 0.5) == 0
    costmap.update(2.0, Pose2D(1.0, 0.0, 0.0))
    assert cost_at(costmap, 0.5, -0.5) == LETHAL and cost_at(costmap, 0.5, 0.5) == 0
    costmap.set_map_from_costmap(Pose2D(-3.0, 0.0, np.pi / 2.0), "zones")  # the robot is found elsewhere
    costmap.update(3.0, Pose2D(1.0, 0.0, 0.0))
    assert cost_at(costmap, 0.5, -0.5) == 0, "the zone is not there any more"


def test_unknown_stays_unknown_where_the_mask_says_nothing():
    costs = keepout_costs()
    assert costs[0] == costs[255] == NO_INFORMATION and costs[100] == LETHAL
    assert 0 < costs[1] < costs[50] < costs[99] < LETHAL - 1


@pytest.mark.parametrize("kind", ["KeepoutFilter", "SpeedFilter"])
def test_without_its_mask_nobody_drives(kind):
    costmap = global_costmap(kind, filter_mask_topic="keepout")
    layer = costmap.layer("static")
    costmap.reconfigure_layer("static", layer.parameters.replace(lethal_cost_threshold=90))
    costmap.set_map(floor(), "static")
    costmap.update(1.0, HERE)
    assert "no mask has come on topic 'keepout'" in costmap.stale_reason(1.0)
    assert "keepout" in costmap.planning_trouble(1.0).message
    costmap.set_map(mask(0), "zones")
    assert costmap.stale_reason(1.0) is None


@pytest.mark.parametrize("group, value, limit", [
    ({}, 40, ZoneLimit(share=0.6)),
    ({"type": 1, "base": 0.0, "multiplier": 1.0}, 40, ZoneLimit(share=0.4)),
    ({"type": 2, "base": 0.5, "multiplier": -0.01}, 40, ZoneLimit(speed=pytest.approx(0.1))),
    ({"type": 2, "base": 0.1, "multiplier": -0.01}, 40, ZoneLimit()),
    ({}, -1, ZoneLimit()),
    ({"base": 300.0}, 40, ZoneLimit()),
])
def test_a_zone_says_how_fast_by_base_and_multiplier(group, value, limit):
    costmap = global_costmap("SpeedFilter", **group)
    costmap.set_map(floor(), "static")
    costmap.set_map(mask(value), "zones")
    costmap.update(1.0, Pose2D(0.5, 0.5, 0.0))
    assert costmap.zone_limit == limit
    costmap.update(1.0, Pose2D(0.95, -0.95, 0.0))
    assert costmap.zone_limit == limit
    for outside in (Pose2D(-0.5, 0.5, 0.0), Pose2D(1.0, 0.5, 0.0), Pose2D(0.5, 1.0, 0.0), Pose2D(0.5, -1.1, 0.0)):
        costmap.update(1.0, outside)
        assert costmap.zone_limit == ZoneLimit()
    assert cost_at(costmap, 0.5, 0.5) == 0, "a speed zone costs nothing"


def test_a_speed_zone_is_found_where_the_map_has_it():
    costmap = global_costmap("SpeedFilter")
    costmap.set_map(mask(50), "zones")
    costmap.set_map_from_costmap(Pose2D(10.0, 0.0, 0.0), "zones")
    costmap.update(1.0, Pose2D(-9.5, 0.0, 0.0))
    assert costmap.zone_limit == ZoneLimit(share=0.5)


def test_a_type_that_is_none_is_told_and_names_are_known():
    assert any("type" in note and "3" in note for note in global_costmap("SpeedFilter", type=3).notes)
    assert list(unknown_names({"plugins": [{"name": "zones", "type": "nav2_costmap_2d::SpeedFilter"}],
                               "zones": {"base": 1.0, "filter_info_topic": "x"}})) == ["zones/filter_info_topic"]


def test_a_filter_that_is_switched_off_limits_nothing():
    costmap = global_costmap("SpeedFilter")
    costmap.set_map(floor(), "static")
    costmap.set_map(mask(40), "zones")
    costmap.update(1.0, Pose2D(0.5, 0.5, 0.0))
    layer = costmap.layer("zones")
    costmap.reconfigure_layer("zones", layer.parameters.replace(enabled=False))
    assert costmap.zone_limit == ZoneLimit()
