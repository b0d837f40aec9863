"""What a depth camera saw is forgotten after a time, as where files list spatio_temporal_voxel_layer's layer."""

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.factory import build_costmap, unknown_names
from mbf_relay.costmap.observation import observation_from_points
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.navigation.examination import DOUBTFUL, IGNORED, REFUSED, STOOD_IN, examine_move_base

DECAY = 5.0
PERSON = (1.0, 0.0)
FILE = {
    "robot_radius": 0.2, "rolling_window": True, "width": 6.0, "height": 5.0, "resolution": 0.1,
    "global_frame": "odom", "footprint_padding": 0.0,
    "plugins": [
        {"name": "rgbd", "type": "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer"},
        {"name": "inflation", "type": "costmap_2d::InflationLayer"}],
    "inflation": {"inflation_radius": 0.4},
    "rgbd": {"voxel_decay": DECAY, "decay_model": 0, "voxel_size": 0.05, "update_footprint_enabled": True,
             "mark_threshold": 0, "publish_voxel_map": False, "observation_sources": "mark",
             "mark": {"topic": "/camera/points", "marking": True, "clearing": False}},
}


def costmap_of(**layer):
    return build_costmap("local_costmap", {**FILE, "rgbd": {**FILE["rgbd"], **layer}})


def see(costmap, now, *points, source="mark"):
    cloud = np.array([(x, y, 0.5) for x, y in points], dtype=float).reshape(-1, 3)
    costmap.observe(source, observation_from_points(cloud, None, np.eye(3), np.zeros(3), now), now)


def cost(costmap, at=PERSON):
    snapshot = costmap.snapshot()
    column, row = snapshot.grid.cell_at(*at)
    return int(snapshot.costs[row, column])


def test_a_person_whom_no_camera_sees_any_more_is_in_the_way_for_voxel_decay_alone():
    costmap = costmap_of()
    costmap.update(0.0, IDENTITY)
    see(costmap, 0.0, PERSON)
    costmap.update(0.1, IDENTITY)
    assert cost(costmap) == LETHAL
    see(costmap, 1.0, (2.0, 2.0))  # turned away
    costmap.update(DECAY - 0.1, IDENTITY)
    assert cost(costmap) == LETHAL
    costmap.update(DECAY + 0.1, IDENTITY)
    assert cost(costmap) == FREE_SPACE and cost(costmap, (0.8, 0.0)) == FREE_SPACE, "with all round it"
    assert cost(costmap, (2.0, 2.0)) == LETHAL


def test_a_wall_that_is_seen_all_the_time_stays():
    costmap = costmap_of()
    costmap.update(0.0, IDENTITY)
    for now in np.arange(0.0, 4.0 * DECAY, 0.5):
        see(costmap, now, PERSON)
        costmap.update(now, IDENTITY)
        assert cost(costmap) == LETHAL


@pytest.mark.parametrize("decay", [0.5, DECAY])
def test_a_person_whom_the_last_picture_of_a_camera_shows_is_not_driven_into_however_late_the_next_one_comes(decay):
    """Of a camera that hangs, or needs longer for a picture than voxel_decay, the C++ layer keeps the last one."""
    costmap = costmap_of(voxel_decay=decay)
    costmap.update(0.0, IDENTITY)
    see(costmap, 0.0, PERSON)
    for now in (0.7, DECAY + 0.1, DECAY + 0.2, 60.0):
        costmap.update(now, IDENTITY)
        assert cost(costmap) == LETHAL, f"after {now} s"
    see(costmap, 60.0)
    costmap.update(60.1, IDENTITY)
    assert cost(costmap) == FREE_SPACE


def test_it_fades_where_it_stands_though_the_window_has_moved():
    costmap = costmap_of()
    costmap.update(0.0, IDENTITY)
    see(costmap, 0.0, PERSON)
    costmap.update(0.1, IDENTITY)
    see(costmap, 1.0)
    costmap.update(2.0, Pose2D(0.0, 1.5, 0.0))
    assert cost(costmap) == LETHAL
    costmap.update(DECAY + 0.1, Pose2D(0.0, 1.5, 0.0))
    assert cost(costmap) == FREE_SPACE


@pytest.mark.parametrize("layer", [{"decay_model": -1}, {"decay_model": 1}, {"voxel_decay": -1.0}])
def test_what_shall_stay_stays_until_a_ray_frees_it(layer):
    costmap = costmap_of(**layer)
    costmap.update(0.0, IDENTITY)
    see(costmap, 0.0, PERSON)
    costmap.update(0.1, IDENTITY)
    see(costmap, 1.0, (2.0, 2.0))
    costmap.update(100.0, IDENTITY)
    assert cost(costmap) == LETHAL


def test_time_set_back_keeps_nobody_in_the_way_for_good():
    costmap = costmap_of()
    costmap.update(1000.0, IDENTITY)
    see(costmap, 1000.0, PERSON)
    costmap.update(1000.1, IDENTITY)
    assert cost(costmap) == LETHAL
    costmap.update(20.0, IDENTITY)
    assert cost(costmap) == FREE_SPACE
    see(costmap, 21.0, PERSON)
    costmap.update(21.1, IDENTITY)
    see(costmap, 22.0)
    costmap.update(21.0 + DECAY - 0.1, IDENTITY)
    assert cost(costmap) == LETHAL, "whoever comes then is in the way for as long as ever"


def test_a_camera_that_marks_nothing_keeps_nobody_in_the_way():
    costmap = costmap_of(observation_sources="mark other", other={"marking": False})
    costmap.update(0.0, IDENTITY)
    see(costmap, 0.0, PERSON)
    costmap.update(0.1, IDENTITY)
    see(costmap, 1.0)
    see(costmap, DECAY, PERSON, source="other")
    costmap.update(DECAY + 0.1, IDENTITY)
    assert cost(costmap) == FREE_SPACE


def test_it_listens_and_reaches_as_the_layer_in_the_file_does():
    source = costmap_of().sources["mark"]
    assert (source.data_type, source.obstacle_range, source.max_obstacle_height) == ("PointCloud2", 3.0, 3.0)
    nearer = build_costmap("local_costmap", {**FILE, "obstacle_range": 2.0})
    assert nearer.sources["mark"].obstacle_range == 2.0
    assert unknown_names(FILE) == {}
    found = examine_move_base({"local_costmap": FILE, "global_costmap": {"robot_radius": 0.2}})
    assert [f for f in found.of(REFUSED, STOOD_IN, IGNORED, DOUBTFUL) if f.name.startswith("local_costmap")] == []


def test_a_robot_whose_layer_has_no_sensor_is_told_so():
    blind = {**FILE, "rgbd": {"voxel_decay": DECAY}}
    found = examine_move_base({"local_costmap": blind, "global_costmap": {"robot_radius": 0.2}})
    assert "local_costmap/rgbd/observation_sources" in {finding.name for finding in found.of(DOUBTFUL)}


def test_what_only_the_c_layer_has_is_told_as_such_and_not_as_misspelt():
    """A dozen warnings "is not known here" greeted everybody whose file followed that layer's examples."""
    source = {
        "topic": "/camera/points", "data_type": "PointCloud2", "enabled": True, "clearing": True, "marking": False,
        "max_z": 7.0, "min_z": 0.1, "vertical_fov_angle": 0.8745, "vertical_fov_padding": 0.05,
        "horizontal_fov_angle": 1.048, "decay_acceleration": 15.0, "model_type": 1, "voxel_filter": False,
        "filter": "voxel", "voxel_min_points": 2, "clear_after_reading": True}
    rgbd = {**FILE["rgbd"], "unknown_threshold": 12, "origin_z": 0.1, "mark": source, "mapping_mode": False}
    file = {**FILE, "rgbd": rgbd}
    assert unknown_names(file) == {}
    assert list(unknown_names({**file, "rgbd": {**rgbd, "mark": {**source, "max_zz": 7.0}}})) == ["rgbd/mark/max_zz"]
    found = examine_move_base({"local_costmap": file})
    told = {f.name: f.text for f in found.of(IGNORED) if f.name.startswith("local_costmap/rgbd")}
    assert "no frustum" in told["local_costmap/rgbd/mark/max_z"] and "local_costmap/rgbd/origin_z" in told
    assert "local_costmap/rgbd/mark/voxel_filter" not in told, "it is at the C++ layer's default"
