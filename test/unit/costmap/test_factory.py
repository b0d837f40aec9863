"""Costmaps out of people's parameter files, whatever form those have."""

import pytest

from mbf_relay.costmap.factory import build_costmap, unknown_names
from mbf_relay.costmap.obstacle_layer import ObstacleLayer, VoxelLayer

SCAN = {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "topic": "front/scan", "marking": True}}


def listed(**types):
    return [{"name": name, "type": type_name} for name, type_name in types.items()]


def test_an_unknown_layer_is_left_out_and_named_and_the_others_do_their_work():
    costmap = build_costmap(
        "global_costmap",
        {
            "plugins": listed(
                explore_boundary="frontier_exploration::BoundedExploreLayer", sonar="costmap_2d::InflationLayer"
            ),
            "explore_boundary": {"resize_to_boundary": False},
        },
    )
    assert [layer.name for layer in costmap.layers] == ["sonar"]
    assert "BoundedExploreLayer" in costmap.failed["explore_boundary"]
    assert unknown_names({"plugins": listed(explore_boundary="frontier_exploration::BoundedExploreLayer")}) == {}


@pytest.mark.parametrize("extra, kind", [({}, ObstacleLayer), ({"z_voxels": 16}, VoxelLayer)])
def test_an_unknown_layer_that_lists_sensors_still_marks_what_they_see(extra, kind):
    costmap = build_costmap("local_costmap", {
        "plugins": listed(obstacles="costmap_2d::FetchDepthLayer"), "obstacles": {**SCAN, **extra},
    })
    assert type(costmap.layers[0]) is kind and costmap.sources["scan"].topic == "front/scan"
    assert any("costmap_2d::FetchDepthLayer is not available here" in note for note in costmap.notes)
    assert not costmap.failed


def test_static_map_true_beside_a_layer_of_that_name_is_passed_over_as_upstream_does():
    costmap = build_costmap(
        "global_costmap", {"plugins": listed(static_map="costmap_2d::StaticLayer"), "static_map": True}
    )
    assert [layer.name for layer in costmap.layers] == ["static_map"]
    assert any("static_map is True" in note for note in costmap.notes)


def test_values_out_of_range_are_taken_to_it_wherever_they_stand():
    costmap = build_costmap(
        "local_costmap",
        {
            "update_frequency": 500.0,
            "plugins": listed(obstacles="costmap_2d::ObstacleLayer", inflation="costmap_2d::InflationLayer"),
            "obstacles": {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "obstacle_range": -1.0}},
            "inflation": {"cost_scaling_factor": 258.0},
        },
    )
    assert costmap.parameters.update_frequency == 100.0
    assert costmap.sources["scan"].obstacle_range == 0.0
    assert costmap.layers[1].parameters.cost_scaling_factor == 100.0
    for words in (
        ("update_frequency", "500.0"),
        ("obstacles", "scan", "obstacle_range"),
        ("inflation", "258.0", "100.0 is used"),
    ):
        assert any(all(word in note for word in words) for note in costmap.notes), words


@pytest.mark.parametrize("kind, name, holds", [
    ("costmap_2d::InflationLayer", "inflation_radius", "costmap"),
    ("costmap_2d::InflationLayer", "cost_scaling_factor", "costmap"),
    ("costmap_2d::StaticLayer", "lethal_cost_threshold", "costmap"),
    ("costmap_2d::VoxelLayer", "z_voxels", "costmap"),
    ("costmap_2d::ObstacleLayer", "max_obstacle_height", "costmap"),
    ("costmap_2d::VoxelLayer", "max_obstacle_height", "layer"),
    ("costmap_2d::InflationLayer", "enabled", "layer"),
])
def test_what_stands_at_both_levels_is_the_costmap_s_where_costmap_2d_copies_it(kind, name, holds):
    """A robot was tuned by its costmap's inflation_radius, which copies over that of a group nobody looks at."""
    values = {"costmap": 4, "layer": 2} if name != "enabled" else {"costmap": True, "layer": False}
    costmap = build_costmap(
        "local_costmap", {"plugins": listed(a=kind), name: values["costmap"], "a": {name: values["layer"]}})
    assert getattr(costmap.layers[0].parameters, name) == values[holds]
    told = [note for note in costmap.notes if f"layer 'a': parameter {name} is" in note]
    assert len(told) == (holds == "costmap")


@pytest.mark.parametrize("form, tallest", [({"plugins": listed(seen="costmap_2d::VoxelLayer")}, 2.0),
                                           ({"map_type": "voxel"}, 0.6)])
def test_a_table_above_a_height_that_costmap_2d_passes_over_stays_an_obstacle(form, tallest):
    """A robot with a depth camera drove below it: a VoxelLayer in a list reads its own group's alone."""
    costmap = build_costmap("local_costmap", {**form, "max_obstacle_height": 0.6})
    assert costmap.layers[0].parameters.max_obstacle_height == tallest
    told = unknown_names({**form, "max_obstacle_height": 0.6})
    assert list(told) == ([] if tallest == 0.6 else ["max_obstacle_height"])


@pytest.mark.parametrize("name, costmaps, layers", [
    ("max_obstacle_height", 0.6, 2.0), ("observation_sources", "scan", "scan camera"),
    ("scan", {"topic": "front"}, {"topic": "rear"}),
])
def test_a_camera_in_a_layers_group_that_gives_way_is_missed_by_who_starts_the_robot(name, costmaps, layers):
    """Without a list of layers all of the costmap's level is moved over the group's; only of a range was that told."""
    costmap = build_costmap("local_costmap", {
        "map_type": "voxel", "observation_sources": "scan", name: costmaps, "obstacle_layer": {name: layers}})
    assert [note for note in costmap.notes if f"layer 'obstacle_layer': parameter {name} is {layers!r}" in note]


def test_a_costmap_that_could_not_see_is_refused():
    """A known layer with a value nobody can make sense of: without it the robot would drive blind."""
    with pytest.raises(ValueError, match="local_costmap.*obstacles.*data_type"):
        build_costmap("local_costmap", {
            "plugins": listed(obstacles="costmap_2d::ObstacleLayer"),
            "obstacles": {"observation_sources": "scan", "scan": {"data_type": "Lidar"}},
        })


@pytest.mark.parametrize("form", [{}, {"plugins": listed(obstacle_layer="costmap_2d::ObstacleLayer")}])
def test_a_group_where_a_number_belongs_is_told_of(form):
    """It was passed over in silence, and the user's number with it."""
    layer = {**SCAN, "track_slowest": {"a": 1}}
    told = unknown_names({**form, "updat_frequency": {"a": 1}, "obstacle_layer": layer})
    assert [name.rpartition("/")[2] for name in told] == ["updat_frequency", "track_slowest"]


@pytest.mark.parametrize("kind", ["costmap_2d::ObstacleLayer", "mbf_relay::TrackLayer"])
def test_a_misspelt_topic_of_a_lidar_is_told_of(kind):
    """The track layer's was not: it listened to another topic, and followed nobody."""
    lidar = {"observation_sources": "front", "front": {"data_type": "LaserScan", "topci": "front/scan"}}
    told = unknown_names({"plugins": listed(layer=kind), "layer": lidar})
    assert list(told) == ["layer/front/topci"] and "'topic'" in told["layer/front/topci"]


def test_groups_that_another_costmap_reads_are_no_news():
    """Many robots load one file of common parameters into both costmaps."""
    assert unknown_names({
        "plugins": listed(inflation="costmap_2d::InflationLayer"), "static_layer": {"enabled": True},
        "obstacle_layer": SCAN, "scan": {"topic": "front/scan"}, "inflation_layer": {},
    }) == {}


@pytest.mark.parametrize("name", ["local_costmap", "global_costmap"])
def test_a_costmap_s_file_that_is_loaded_one_level_too_deep_is_told_of(name):
    """A wheelchair's was, and all of it without effect: the costmap stood still in a corner, in silence."""
    whole = {"update_frequency": 5.0, "rolling_window": True, "plugins": [], "obstacle_layer": SCAN}
    told = unknown_names({"robot_radius": 0.2, "obstacle_layer": SCAN, name: whole})
    assert list(told) == [name] and f"a file that begins with '{name}:' is loaded without ns" in told[name]


CAR = [[-0.1, -0.125], [0.5, -0.125], [0.5, 0.125], [-0.1, 0.125]]


@pytest.mark.parametrize("sides, footprint, used", [
    ((0.5, 0.5), CAR, (2.1, 2.1)),  # a car of 0.6 m, which would reach out of it everywhere
    ((4.0, 1.0), CAR, (4.0, 2.1)),
    ((1.1, 1.1), CAR, (2.1, 2.1)),
    ((2.2, 2.2), CAR, (2.2, 2.2)),
    ((0.5, 0.5), [[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]], (0.6, 0.6)),  # it saw a centimetre ahead
    ((1.0, 1.0), [[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]], (1.0, 1.0)),
])
def test_a_robot_nearly_as_long_as_its_window_sees_what_it_reaches_and_where_it_drives(sides, footprint, used):
    """Nothing but its own length stood in its way: it was told that it stood on an obstacle, or gave up at a bend."""
    given = {"width": sides[0], "height": sides[1], "footprint": footprint, "resolution": 0.05}
    costmap = build_costmap("local_costmap", {**given, "rolling_window": True})
    assert (costmap.parameters.width, costmap.parameters.height) == pytest.approx(used, abs=0.05)
    told = [note for note in costmap.notes if "must be twice as wide" in note]
    assert len(told) == (used != sides)
    wide = build_costmap("local_costmap", {**given, "rolling_window": True, "width": 9.0, "height": 9.0}).parameters
    changed, notes = wide.reconfigured({"width": sides[0], "height": sides[1]})
    assert (changed.width, changed.height) == pytest.approx(used, abs=0.05) and len(notes) == (used != sides)
    fixed = build_costmap("global_costmap", given)
    assert (fixed.parameters.width, fixed.parameters.height) == pytest.approx(sides, abs=0.05)


def test_a_robot_that_gets_a_longer_outline_while_it_drives_sees_beyond_it():
    """With a trailer told of at run time it reached out of its window, and stood."""
    small = build_costmap("local_costmap", {"rolling_window": True, "width": 1.0, "height": 1.0, "robot_radius": 0.2})
    changed, (note,) = small.parameters.reconfigured({"footprint": str(CAR)})
    assert (changed.width, changed.height) == pytest.approx((2.1, 2.1), abs=0.05) and "twice as wide" in note
