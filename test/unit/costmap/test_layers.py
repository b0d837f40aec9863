"""The layers one by one: what each makes of maps, scans and clouds."""

import math
import re

import numpy as np
import pytest

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import EMPTY, FREE_SPACE, LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import Layer, changed_window, shifted
from mbf_relay.costmap.observation import Observation, observation_from_points, observation_from_scan, scan_points
from mbf_relay.costmap.obstacle_layer import free_within
from mbf_relay.costmap.static_layer import StaticLayerParameters, cost_table
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import OccupancyMap
from mbf_relay.parameters import ParameterSet
from mbf_relay.scan import LaserScan

STILL = {
    "global_frame": "map", "width": 4.0, "height": 4.0, "resolution": 0.1, "origin_x": -2.0, "origin_y": -2.0,
    "robot_radius": 0.1, "footprint_padding": 0.0, "transform_tolerance": 0.5,
}


def with_obstacles(source=None, **layer):
    source = {"data_type": "LaserScan", "marking": True, "clearing": True, **(source or {})}
    group = {"observation_sources": "scan", "scan": source, "footprint_clearing_enabled": False, **layer}
    return factory.build_costmap(
        "costmap",
        {**STILL, "plugins": [{"name": "obstacles", "type": "costmap_2d::ObstacleLayer"}], "obstacles": group},
    )


def with_map(**layer):
    return factory.build_costmap(
        "costmap", {**STILL, "plugins": [{"name": "static", "type": "costmap_2d::StaticLayer"}], "static": layer})


def cost_at(costmap, x, y):
    snapshot = costmap.snapshot()
    column, row = snapshot.grid.cell_at(x, y)
    return int(snapshot.costs[row, column])


# --- what sensors see

@pytest.mark.parametrize("beams, sees", [(360, True), (270, False), (30, False), (1, False), (0, False)])
def test_a_lidar_sees_all_round_where_its_beams_go_all_round(beams, sees):
    costmap = with_obstacles()
    assert not costmap.sees_all_round
    scan = LaserScan(np.full(beams, math.inf), -2.0, math.radians(1.0), 0.1, 3.0, 1.0)
    costmap.observe("scan", observation_from_scan(scan, Pose2D(0.5, 0.2, 1.0)))
    assert costmap.sees_all_round is sees


# --- the static layer

def test_a_trinary_map_knows_free_lethal_and_unknown():
    table = cost_table(StaticLayerParameters(lethal_cost_threshold=65))
    assert [table[value] for value in (0, 1, 64, 65, 100, 255)] == [
        FREE_SPACE, FREE_SPACE, FREE_SPACE, LETHAL, LETHAL, NO_INFORMATION]


def test_a_scaled_map_has_costs_between():
    table = cost_table(StaticLayerParameters(lethal_cost_threshold=80, trinary_costmap=False))
    assert [table[value] for value in (0, 20, 40, 79, 80, 100)] == [0, 63, 127, int(79 / 80 * 254), LETHAL, LETHAL]


def test_unknown_space_is_free_where_it_is_not_tracked_and_its_value_can_be_chosen():
    assert cost_table(StaticLayerParameters(track_unknown_space=False))[255] == FREE_SPACE
    table = cost_table(StaticLayerParameters(unknown_cost_value=50))
    assert table[50] == NO_INFORMATION and table[255] == LETHAL  # as in costmap_2d, -1 is then but a high value


def test_a_map_gives_the_costmap_its_size_and_a_notice_of_another_resolution():
    costmap = with_map()
    data = np.zeros((30, 50), dtype=np.int8)
    data[3, 4] = 100
    notice = costmap.set_map(OccupancyMap(data, 0.2, Pose2D(1.0, 2.0, 0.0)))
    assert "0.2 m" in notice and "0.1 m" in notice
    costmap.update(0.0, Pose2D(3.0, 4.0, 0.0))
    snapshot = costmap.snapshot()
    assert snapshot.grid == Grid(0.2, 1.0, 2.0, 50, 30)
    assert np.argwhere(snapshot.costs == LETHAL).tolist() == [[3, 4]]


def test_map_updates_change_their_window_alone():
    costmap = with_map(subscribe_to_updates=True)
    data = np.zeros((40, 40), np.int8)
    data[0, 0] = -1
    costmap.set_map(OccupancyMap(np.ones_like(data), 0.1, Pose2D(0.0, 0.0, 0.0)))
    costmap.update_map(0, 0, data)
    costmap.update(0.0, IDENTITY)
    before = costmap.snapshot()
    costmap.update_map(10, 20, np.full((2, 3), 100, np.int8))
    costmap.update(0.1, IDENTITY)
    after = costmap.snapshot()
    assert after.changed_since(before.revision) == Window(10, 20, 13, 22)
    assert (after.costs[20:22, 10:13] == LETHAL).all() and (after.costs == LETHAL).sum() == 6
    for x, y in (38, 0), (-1, 0), (0, 39), (0, -1):
        with pytest.raises(ValueError, match="does not fit"):
            costmap.update_map(x, y, np.zeros((2, 3), np.int8))
    layer = costmap.layers[0]
    layer.reconfigure(layer.parameters.replace(track_unknown_space=False))
    costmap.update(0.2, IDENTITY)
    assert np.argwhere(costmap.snapshot().costs != after.costs).tolist() == [[0, 0]], "what was unknown is free now"


def test_a_new_map_replaces_the_old_one():
    costmap = with_map()
    data = np.zeros((20, 20), np.int8)
    data[5, 5] = 100
    for column in (5, 8):
        data = np.zeros((20, 20), np.int8)
        data[5, column] = 100
        costmap.set_map(OccupancyMap(data, 0.1, Pose2D(0.0, 0.0, 0.0)))
        costmap.update(0.0, IDENTITY)
    assert np.argwhere(costmap.snapshot().costs == LETHAL).tolist() == [[5, 8]]


def test_a_window_in_another_frame_shows_the_map_where_it_lies():
    values = {**STILL, "rolling_window": True, "plugins": [{"name": "static", "type": "costmap_2d::StaticLayer"}]}
    costmap = factory.build_costmap("costmap", values)
    costmap.update(0.0, IDENTITY)  # before the map has come
    data = np.zeros((100, 100), np.int8)
    data[60, 70] = 100  # its centre at (2.05, 1.05) on the map
    costmap.set_map(OccupancyMap(data, 0.1, Pose2D(-5.0, -5.0, 0.0)))
    for map_from_costmap in Pose2D(1.0, 1.0, math.pi / 2.0), Pose2D(1.3, 1.0, 0.0):  # the robot is found elsewhere
        costmap.set_map_from_costmap(map_from_costmap)
        costmap.update(0.0, IDENTITY)
        found = np.argwhere(costmap.snapshot().costs == LETHAL)
        x, y = costmap.snapshot().grid.center_of(int(found[0][1]), int(found[0][0]))
        seen = map_from_costmap.compose(Pose2D(x, y, 0.0))
        assert (seen.x, seen.y) == pytest.approx((2.05, 1.05), abs=0.08)


# --- the obstacle layer

def test_ranges_bound_what_is_marked_and_what_is_cleared():
    costmap = with_obstacles({"obstacle_range": 1.0, "raytrace_range": 0.5})
    costmap.observe("scan", Observation((0.05, 0.05), np.array([[0.95, 0.05], [0.05, 1.5]]), None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert cost_at(costmap, 0.95, 0.05) == LETHAL
    assert cost_at(costmap, 0.05, 1.5) == FREE_SPACE  # too far to be marked
    costmap.observe("scan", Observation((0.05, 0.05), np.array([[1.9, 0.05]]), None, 0.1))
    costmap.update(0.1, IDENTITY)
    assert cost_at(costmap, 0.95, 0.05) == LETHAL  # too far to be cleared


def test_heights_bound_what_a_cloud_says():
    costmap = with_obstacles({"data_type": "PointCloud2", "min_obstacle_height": 0.1, "max_obstacle_height": 1.0})
    points = np.array([[0.5, 0.0, 0.05], [0.7, 0.0, 0.5], [0.9, 0.0, 1.5], [np.nan, 0.0, 0.5]])
    costmap.observe("scan", Observation((0.0, 0.0, 0.3), points, None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert [cost_at(costmap, x, 0.0) for x in (0.5, 0.7, 0.9)] == [FREE_SPACE, LETHAL, FREE_SPACE]


VOXELS = {"z_voxels": 5, "origin_z": 0.1, "z_resolution": 0.2, "unknown_threshold": 15, "mark_threshold": 0,
          "publish_voxel_map": True}


@pytest.mark.parametrize("form", ["old", "new"])
def test_a_voxel_layers_parameters_are_known_in_both_forms(form):
    group = {"observation_sources": "scan", "scan": {"data_type": "LaserScan"}, **VOXELS}
    values = {**STILL, "map_type": "voxel", **group} if form == "old" else {
        **STILL, "plugins": [{"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}], "obstacle_layer": group}
    assert factory.unknown_names(values) == {}
    layer = factory.build_costmap("costmap", values).layer("obstacle_layer")
    assert {name: getattr(layer.parameters, name) for name in VOXELS} == VOXELS
    assert "one plane" in layer.notice
    assert list(factory.unknown_names({**STILL, "z_voxels": 5})) == ["z_voxels"]  # no voxel layer: nothing reads it


@pytest.mark.parametrize("package", ["rtabmap_ros", "rtabmap_costmap_plugins"])
def test_a_robot_whose_map_rtabmap_makes_keeps_its_walls(package):
    values = {**STILL, "plugins": [{"name": "static_layer", "type": f"{package}::StaticLayer"}],
              "static_layer": {"map_topic": "grid_map"}}
    assert factory.build_costmap("costmap", values).layer("static_layer").parameters.map_topic == "grid_map"


@pytest.mark.parametrize("change, top", [({}, 1.1), ({"z_voxels": 2}, 0.5), ({"max_obstacle_height": 0.7}, 0.7)])
def test_points_above_the_highest_voxel_mark_nothing(change, top):
    source = {"data_type": "PointCloud2", "marking": True, "clearing": False, "max_obstacle_height": 5.0}
    costmap = factory.build_costmap("costmap", {
        **STILL, "plugins": [{"name": "voxels", "type": "costmap_2d::VoxelLayer"}],
        "voxels": {
            "observation_sources": "scan", "scan": source, "footprint_clearing_enabled": False, **VOXELS, **change}})
    points = np.array([[0.55, 0.05, top - 0.01], [1.05, 0.05, top + 0.01]])
    costmap.observe("scan", Observation((0.0, 0.0, 0.3), points, None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert (cost_at(costmap, 0.55, 0.05), cost_at(costmap, 1.05, 0.05)) == (LETHAL, FREE_SPACE)


def test_observations_count_as_long_as_they_persist():
    for persistence, count in ((0.0, 1), (1.0, 3)):
        costmap = with_obstacles({"clearing": False, "observation_persistence": persistence})
        for step in range(4):
            costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.3 + 0.3 * step, 0.0]]), None, 0.5 * step))
        costmap.update(1.5, IDENTITY)
        assert (costmap.snapshot().costs == LETHAL).sum() == count


@pytest.mark.parametrize("persistence", [0.0, 1.0])
def test_a_scan_leaves_the_same_cells_however_often_they_are_updated_on_it(persistence):
    rng = np.random.default_rng(7)
    layer = {"footprint_clearing_enabled": True, "track_unknown_space": True}
    source = {"data_type": "PointCloud2", "observation_persistence": persistence}  # a lidar's second look tells more
    once, anew = (with_obstacles(source, **layer) for _ in range(2))
    for step in range(60):
        pose = Pose2D(*rng.uniform(-1.5, 1.5, 2), 0.0)
        points = np.column_stack((rng.uniform(-2.5, 2.5, 30), rng.uniform(-2.5, 2.5, 30)))
        seen = Observation((pose.x, pose.y), points, rng.random(30) < 0.7, float(step))
        for update in range(3):
            robot = Pose2D(pose.x + 0.2 * update, pose.y, 0.0)
            for costmap in (once, anew):
                if costmap is anew or update == 0:
                    costmap.observe("scan", seen, float(step))
                if step % 7 == 3 and update == 1:
                    costmap.clear(around=robot, side=1.0, inside=step % 2 == 0)
                costmap.update(step + 0.1 * update, robot)
            assert (once.snapshot().costs == anew.snapshot().costs).all(), f"update {update} on scan {step}"
            assert (once.layers[0].costs == anew.layers[0].costs).all(), "what is known to be free differs"


def test_what_is_not_seen_any_more_is_gone_where_the_robot_has_stood_and_there_alone():
    """A robot that drove over what was a false reading stood on an obstacle by its costmap."""
    costmap, rng = with_obstacles(footprint_clearing_enabled=True), np.random.default_rng(3)
    costmap.set_footprint(np.array([[0.55, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.55, -0.25]]))
    for stamp, count in (0.0, 3000), (1.0, 0):
        costmap.observe("scan", Observation((0.0, 0.0), rng.uniform(-2.0, 2.0, (count, 2)), None, stamp))
        costmap.update(stamp, Pose2D(-1.0, 0.0, 0.0))
    marked = costmap.snapshot().costs == LETHAL
    for step in range(20):
        pose = Pose2D(*rng.uniform((-1.9, -1.9, -3.0), (1.9, 1.9, 3.0)))
        costmap.update(1.1 + 0.1 * step, pose)
        snapshot = costmap.snapshot()
        untouched = np.full(snapshot.grid.shape, LETHAL, np.uint8)
        free_within(snapshot.grid, untouched, snapshot.footprint, pose)
        marked &= untouched == LETHAL
        assert ((snapshot.costs == LETHAL) == marked).all(), f"step {step}"


def test_a_source_that_only_clears_marks_nothing_and_the_other_way_round():
    clears, marks = with_obstacles({"marking": False}), with_obstacles({"clearing": False})
    for costmap in (clears, marks):
        costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.5, 0.0]]), None, 0.0))
        costmap.update(0.0, IDENTITY)
    assert cost_at(clears, 0.5, 0.0) == FREE_SPACE and cost_at(marks, 0.5, 0.0) == LETHAL
    marks.observe("scan", Observation((0.0, 0.0), np.array([[1.5, 0.0]]), None, 0.1))
    marks.update(0.1, IDENTITY)
    assert cost_at(marks, 0.5, 0.0) == LETHAL


def test_beams_without_a_return_clear_up_to_the_range_and_mark_nothing():
    ranges = np.array([np.inf, 3.5, 3.4999, np.nan, 0.05, -np.inf, 1.0])
    scan = LaserScan(ranges, 0.0, 0.1, 0.12, 3.5, 0.0)
    points, hits = scan_points(scan)
    assert hits.tolist() == [False, False, False, True]
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx([3.5, 3.5, 3.5, 1.0])
    points, hits = scan_points(scan, inf_is_valid=False)
    assert hits.tolist() == [True] and len(points) == 1


def test_a_tilted_sensors_points_are_turned_in_space():
    upside_down = np.diag([1.0, -1.0, -1.0])
    seen = observation_from_points(
        np.array([[1.0, 0.5]]), np.array([True]), upside_down, np.array([0.2, 0.0, 0.4]), 3.0)
    assert seen.origin == (0.2, 0.0, 0.4) and seen.points[0] == pytest.approx([1.2, -0.5, 0.4])


def test_a_cloud_is_turned_in_space_point_by_point_and_what_is_no_number_is_left_out():
    rng = np.random.default_rng(3)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points, place = rng.normal(0.0, 3.0, (500, 3)), np.array([0.1, -2.0, 0.4])
    points[rng.random(points.shape) < 0.1] = np.nan
    points[rng.random(points.shape) < 0.02] = np.inf
    seen = observation_from_points(points[::2, :], None, rotation.T[:, ::-1], place, 1.0)
    finite = points[::2][np.isfinite(points[::2]).all(axis=1)]
    assert 0 < len(finite) < 250 and seen.hits is None
    assert seen.points == pytest.approx(finite @ rotation.T[:, ::-1].T + place)


def test_a_level_scan_is_the_same_by_either_way():
    rng = np.random.default_rng(0)
    scan = LaserScan(rng.uniform(0.2, 3.0, 50), -1.0, 0.05, 0.12, 3.5, 1.0)
    pose = Pose2D(0.3, -0.2, 0.7)
    rotation = np.array([[math.cos(0.7), -math.sin(0.7), 0.0], [math.sin(0.7), math.cos(0.7), 0.0], [0.0, 0.0, 1.0]])
    flat = observation_from_scan(scan, pose, height=0.2)
    points, hits = scan_points(scan)
    solid = observation_from_points(points, hits, rotation, np.array([0.3, -0.2, 0.2]), 1.0)
    assert flat.points == pytest.approx(solid.points) and flat.origin == solid.origin


def test_unknown_space_is_known_only_where_rays_passed():
    costmap = with_obstacles(track_unknown_space=True)
    costmap.observe("scan", Observation((0.05, 0.05), np.array([[1.05, 0.05]]), None, 0.0))
    costmap.update(0.0, IDENTITY)
    # the costmap's own default is free; only the layer says nothing
    layer = costmap.layer("obstacles")
    assert (layer.costs == FREE_SPACE).sum() == 10 and (layer.costs == LETHAL).sum() == 1
    assert (layer.costs == NO_INFORMATION).sum() == 1600 - 11


def test_an_unknown_source_is_named():
    with pytest.raises(ValueError, match="'sonar'.*scan"):
        with_obstacles().observe("sonar", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.0))


def test_the_expected_update_rate_makes_a_source_stale():
    costmap = with_obstacles({"expected_update_rate": 0.3})
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert costmap.stale_reason(0.2) is None
    assert "at most 0.30 s" in costmap.stale_reason(0.5)
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.45), now=0.5)
    assert costmap.stale_reason(0.5) is None
    costmap.update(0.5, IDENTITY)
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 2.0), now=2.0)
    assert "last updated" in costmap.stale_reason(2.0)


# --- layers of a user's own

class Puddle(Layer):
    """A layer as a user may write one: a square of costs."""

    Parameters = ParameterSet

    def update_bounds(self, context, window):
        return window.union(Window(5, 5, 8, 9))

    def update_costs(self, costs, window):
        costs[5:9, 5:8] = 77


def test_a_layer_is_a_class_and_a_line():
    kinds = [{"name": "puddle", "type": f"{__name__}.Puddle"}]
    costmap = factory.build_costmap("costmap", {**STILL, "plugins": kinds})
    costmap.update(0.0, IDENTITY)
    assert (costmap.snapshot().costs == 77).sum() == 12


@pytest.mark.parametrize("type_name, said", [
    (f"{__name__}.Swamp", "has no attribute 'Swamp'"), ("no_such_package.Layer", "is its folder on PYTHONPATH?")])
@pytest.mark.parametrize("sources", [{}, {"observation_sources": "scan", "scan": {"data_type": "LaserScan"}}])
def test_a_robot_does_not_drive_without_the_layer_that_was_written_for_it(type_name, said, sources):
    """What it would have kept the robot from was not in the costmap, and one line of the log said so."""
    with pytest.raises(ValueError, match=f"costmap: layer 'a': layer type '{type_name}'.*{re.escape(said)}"):
        factory.build_costmap("costmap", {**STILL, "plugins": [{"name": "a", "type": type_name}], "a": sources})


# --- windows

def test_windows_join_grow_shift_and_are_cut():
    window = Window(2, 3, 5, 7)
    assert window.union(EMPTY) == window == EMPTY.union(window)
    assert window.union(Window(0, 6, 3, 9)) == Window(0, 3, 5, 9)
    assert window.grown(4).within(Grid(1.0, 0.0, 0.0, 6, 8)) == Window(0, 0, 6, 8)
    for aside in Window(-9, 1, -4, 5), Window(1, -9, 5, -4), Window(20, 1, 25, 5), Window(1, 20, 5, 25):
        outside = aside.within(Grid(1.0, 0.0, 0.0, 6, 8))
        assert outside.is_empty and np.ones((8, 6))[outside.slices].size == 0
    assert EMPTY.grown(3).is_empty and window.shifted(1, -1) == Window(3, 2, 6, 6)


def test_the_window_of_a_change_is_the_smallest():
    rng = np.random.default_rng(0)
    for _ in range(50):
        before = rng.integers(0, 255, (20, 30)).astype(np.uint8)
        costs = rng.integers(0, 255, (230, 140)).astype(np.uint8)
        costs[200:220, 100:130] = before
        cells = rng.integers(0, 20, (rng.integers(0, 4), 2))
        costs[200 + cells[:, 0], 100 + cells[:, 1]] ^= rng.integers(1, 255, len(cells)).astype(np.uint8)
        cells = np.argwhere(costs[200:220, 100:130] != before)
        window = changed_window(before, costs, Window(100, 200, 130, 220))
        if len(cells) == 0:
            assert window.is_empty
        else:
            assert window == Window(
                100 + cells[:, 1].min(), 200 + cells[:, 0].min(), 101 + cells[:, 1].max(), 201 + cells[:, 0].max()
            )


@pytest.mark.parametrize("columns, rows", [
    (0, 0), (3, -2), (-5, 4), (100, 0), (-1, -100), (15, -2), (-15, 2), (3, 11), (-3, -11)])
def test_shifting_keeps_what_is_in_both_windows(columns, rows):
    costs = np.arange(80, dtype=np.uint8).reshape(8, 10)
    moved = shifted(costs, columns, rows, 255)
    for y in range(8):
        for x in range(10):
            inside = 0 <= x + columns < 10 and 0 <= y + rows < 8
            assert moved[y, x] == (costs[y + rows, x + columns] if inside else 255)
