"""The costmap as a whole: made from files of both forms, fed, updated, seen."""

import math
import threading

import numpy as np
import pytest
import yaml

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import FREE_SPACE, INSCRIBED, LETHAL, Window
from mbf_relay.costmap.observation import Observation, observation_from_scan
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

OLD_FORM_GLOBAL = yaml.safe_load("""
obstacle_range: 3.0
raytrace_range: 3.5
footprint: [[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]]
inflation_radius: 1.0
cost_scaling_factor: 3.0
map_type: costmap
observation_sources: scan
scan: {sensor_frame: base_scan, data_type: LaserScan, topic: scan, marking: true, clearing: true}
global_frame: map
robot_base_frame: base_footprint
update_frequency: 10.0
publish_frequency: 10.0
transform_tolerance: 0.5
static_map: true
""")

NEW_FORM = yaml.safe_load("""
global_frame: odom
robot_base_frame: base_footprint
update_frequency: 10.0
rolling_window: true
width: 3
height: 3
resolution: 0.05
robot_radius: 0.1
footprint_padding: 0.0
plugins:
  - {name: obstacles, type: "costmap_2d::ObstacleLayer"}
  - {name: inflation, type: "costmap_2d::InflationLayer"}
obstacles:
  observation_sources: scan
  scan: {data_type: LaserScan, marking: true, clearing: true, obstacle_range: 3.0, raytrace_range: 3.5}
inflation: {inflation_radius: 1.0, cost_scaling_factor: 3.0}
""")


def room(size=80, resolution=0.05):
    data = np.zeros((size, size), dtype=np.int8)
    data[0, :] = data[-1, :] = data[:, 0] = data[:, -1] = 100
    return OccupancyMap(data, resolution, Pose2D(-size * resolution / 2.0, -size * resolution / 2.0, 0.0))


def test_the_form_without_plugins_makes_the_three_layers():
    costmap = factory.build_costmap("global_costmap", OLD_FORM_GLOBAL)
    assert [layer.name for layer in costmap.layers] == ["static_layer", "obstacle_layer", "inflation_layer"]
    assert (costmap.frame, costmap.robot_frame) == ("map", "base_footprint")
    source = costmap.sources["scan"]
    assert (source.topic, source.obstacle_range, source.raytrace_range) == ("scan", 3.0, 3.5)
    assert costmap.layer("inflation_layer").parameters.inflation_radius == 1.0
    assert factory.unknown_names(OLD_FORM_GLOBAL) == {}


def test_the_form_with_plugins_makes_those_listed():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    assert [layer.name for layer in costmap.layers] == ["obstacles", "inflation"]
    assert costmap.sources["scan"].raytrace_range == 3.5
    assert factory.unknown_names(NEW_FORM) == {}
    misspelt = {**NEW_FORM, "robot_radios": 1.0, "obstacles": {**NEW_FORM["obstacles"], "scam": 1, "enabld": True}}
    assert factory.unknown_names(misspelt) == {
        "robot_radios": "; did you mean 'robot_radius'?", "obstacles/scam": "",
        "obstacles/enabld": "; did you mean 'enabled'?",
    }


def test_a_parameter_of_a_layer_that_is_not_there_is_told_of_by_that_layer():
    """`z_resolution` is no slip for `resolution`."""
    file = {**OLD_FORM_GLOBAL, "z_resolution": 0.2, "plugins": [], "static_map": False}
    hints = factory.unknown_names(file)
    assert hints["z_resolution"] == "; costmap_2d::VoxelLayer reads it, which is not among the layers"
    assert hints["inflation_radius"] == "; costmap_2d::InflationLayer reads it, which is not among the layers"


@pytest.mark.parametrize("change, named", [
    ({"plugins": [{"name": "a"}]}, "plugins holds"),
    ({"resolution": -0.05}, "resolution is -0.05"),
    ({"footprint": [[0, 0], [1, 1]]}, "2 points"),
    ({"robot_radius": -1.0}, "robot_radius is -1.0"),
    ({"obstacles": {"observation_sources": "scan", "scan": {"data_type": "Sonar"}}}, "Sonar"),
])
def test_bad_parameters_are_named_with_their_value(change, named):
    with pytest.raises(ValueError, match="local_costmap.*") as error:
        factory.build_costmap("local_costmap", {**NEW_FORM, **change})
    assert named in str(error.value)


def test_static_map_gives_size_and_costs():
    costmap = factory.build_costmap("global_costmap", OLD_FORM_GLOBAL)
    assert costmap.stale_reason(0.0) is not None
    costmap.set_map(room())
    costmap.update(1.0, IDENTITY)
    snapshot = costmap.snapshot()
    assert snapshot.costs.shape == (80, 80)
    assert (snapshot.costs[0] == LETHAL).all()
    assert snapshot.costs[1, 40] == INSCRIBED  # 0.05 m from the wall, within the inscribed 0.051 m
    assert snapshot.costs[40, 40] == FREE_SPACE
    assert snapshot.costs[10, 40] == int(252 * math.exp(-3.0 * (0.5 - 0.051)))


def test_scan_marks_clears_and_the_picture_stays_as_it_was_seen():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    sees = LaserScan(np.array([1.0, np.inf, 0.5]), 0.0, math.pi / 2.0, 0.12, 3.5, 1.0)
    costmap.observe("scan", observation_from_scan(sees, IDENTITY))
    costmap.update(1.0, IDENTITY)
    first = costmap.snapshot()
    ahead, behind = first.grid.cell_at(1.0, 0.0), first.grid.cell_at(-0.5, 0.0)
    assert first.costs[ahead[1], ahead[0]] == first.costs[behind[1], behind[0]] == LETHAL
    gone = LaserScan(np.array([np.inf, np.inf, 0.5]), 0.0, math.pi / 2.0, 0.12, 3.5, 2.0)
    costmap.observe("scan", observation_from_scan(gone, IDENTITY))
    costmap.update(2.0, IDENTITY)
    second = costmap.snapshot()
    assert second.costs[ahead[1], ahead[0]] == FREE_SPACE
    assert first.costs[ahead[1], ahead[0]] == LETHAL
    assert second.revision > first.revision
    changed = second.changed_since(first.revision)
    outside = np.ones(second.costs.shape, dtype=bool)
    outside[changed.slices] = False
    assert (first.costs[outside] == second.costs[outside]).all()
    costmap.update(2.1, IDENTITY)
    assert costmap.snapshot().revision == second.revision


def test_rolling_window_moves_with_the_robot_and_keeps_obstacles_in_place():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.01, 0.01]]), None, 0.0))
    costmap.update(0.0, IDENTITY)
    costmap.observe("scan", Observation((0.7, 0.3), np.zeros((0, 2)), None, 0.1))
    costmap.update(0.1, Pose2D(0.7, 0.3, 0.0))
    snapshot = costmap.snapshot()
    assert snapshot.grid.origin_x == pytest.approx(0.7 - 1.5, abs=0.05)
    column, row = snapshot.grid.cell_at(1.01, 0.01)
    assert snapshot.costs[row, column] == LETHAL
    assert (snapshot.costs == LETHAL).sum() == 1
    costmap.update(0.2, Pose2D(50.0, 3.0, 0.0))
    assert (costmap.snapshot().costs == FREE_SPACE).all()


def test_updates_in_windows_give_what_an_update_of_everything_gives():
    rng = np.random.default_rng(7)
    stepwise = factory.build_costmap("local_costmap", NEW_FORM)
    for step in range(40):
        pose = Pose2D(0.03 * step, 0.02 * step, 0.1 * step)
        points = pose.transform_points(rng.uniform(-2.0, 2.0, (60, 2)))
        stepwise.observe("scan", Observation((pose.x, pose.y), points, rng.random(60) < 0.7, float(step)))
        stepwise.update(float(step), pose)
        costs = np.zeros((60, 60), dtype=np.uint8)
        for layer in stepwise.layers:
            layer.update_costs(costs, Window(0, 0, 60, 60))
        assert (costs == stepwise.snapshot().costs).all(), step


def test_clearing_forgets_the_square_or_all_but_it():
    for inside in (True, False):
        costmap = factory.build_costmap("local_costmap", NEW_FORM)
        costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.5, 0.0], [1.2, 0.0]]), None, 0.0))
        costmap.update(0.0, IDENTITY)
        costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.1))
        costmap.clear(around=IDENTITY, side=1.6, inside=inside)
        costmap.update(0.1, IDENTITY)
        snapshot = costmap.snapshot()
        left = np.argwhere(snapshot.costs == LETHAL)[:, ::-1].tolist()
        assert left == [list(snapshot.grid.cell_at(1.2 if inside else 0.5, 0.0))]


@pytest.mark.parametrize("x, y", [(-2.5, 0.0), (2.5, 0.0), (0.0, -2.5), (0.0, 2.5)])
def test_a_robot_beside_the_map_has_all_that_is_far_from_it_forgotten(x, y):
    """Left of or below the map nearly nothing was."""
    costmap = factory.build_costmap(
        "global_costmap", {**NEW_FORM, "rolling_window": False, "origin_x": -1.5, "origin_y": -1.5})
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.5, 0.5], [-0.5, -0.5]]), None, 0.0))
    costmap.update(0.0, IDENTITY)
    assert (costmap.snapshot().costs == LETHAL).sum() == 2
    costmap.observe("scan", Observation((x, y), np.zeros((0, 2)), None, 0.1))
    costmap.clear(around=Pose2D(x, y, 0.0), side=1.0, inside=False)
    costmap.update(0.1, Pose2D(x, y, 0.0))
    assert not (costmap.snapshot().costs == LETHAL).any()


def test_stale_sources_are_named_with_their_age():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    costmap.update(0.0, IDENTITY)
    assert "no data has come from lidar source 'scan'" in costmap.stale_reason(0.0)
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.0))
    assert costmap.stale_reason(0.5) is None
    costmap.update(3.0, IDENTITY)
    assert "3.00 s" in costmap.stale_reason(3.0)


def test_a_costmap_that_sees_and_is_never_updated_is_planned_on_but_not_driven_on():
    seen_by_camera = yaml.safe_load(yaml.safe_dump(NEW_FORM).replace("LaserScan", "PointCloud2"))
    costmap = factory.build_costmap("local_costmap", {**seen_by_camera, "update_frequency": 0.0})
    costmap.update(0.0, IDENTITY)
    assert costmap.stale_reason(0.5) is None  # as after a client had it updated
    assert costmap.stale_reason(60.0) == (
        "local_costmap was last updated 60.00 s ago; at most 1.00 s is allowed: its update_frequency is 0")
    assert costmap.planning_trouble(60.0) is None


def test_a_lidar_is_not_blamed_where_the_costmap_takes_nothing_up():
    """Of a costmap whose updates were switched off in a drive it was said that the lidar sent nothing."""
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.1))
    costmap.update(0.1, IDENTITY)
    costmap.reconfigure(costmap.parameters.replace(update_frequency=0.0))
    assert costmap.stale_reason(60.0).endswith("its update_frequency is 0")


def test_whoever_waits_for_a_sensor_is_told_why_what_it_sent_was_not_used():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    costmap.update(0.0, IDENTITY)
    why = "message dropped after 0.53 s: no transform from 'laser' to 'odom'"
    costmap.refuse("scan", why, is_blind=False)
    assert costmap.stale_reason(0.0) == (
        f"local_costmap: nothing from lidar source 'scan' on topic 'scan' could be used: {why}")
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 0.0))
    costmap.refuse("scan", why, is_blind=False)
    assert costmap.stale_reason(0.1) is None  # one message lost is no reason to stop
    costmap.update(3.0, IDENTITY)
    assert "3.00 s" in costmap.stale_reason(3.0) and costmap.stale_reason(3.0).endswith(why)
    costmap.observe("scan", Observation((0.0, 0.0), np.zeros((0, 2)), None, 3.0))
    costmap.update(6.0, IDENTITY)
    assert why not in costmap.stale_reason(6.0)


def test_threads_may_observe_update_and_look_at_once():
    costmap = factory.build_costmap("local_costmap", NEW_FORM)
    errors = []

    def guarded(work):
        try:
            for step in range(150):
                work(step)
        except Exception as error:  # the test reports whatever a thread met
            errors.append(error)

    rng = np.random.default_rng(1)
    points = rng.uniform(-2.0, 2.0, (100, 2))
    works = [
        lambda step: costmap.observe("scan", Observation((0.0, 0.0), points, None, 0.1 * step)),
        lambda step: costmap.update(0.1 * step, Pose2D(0.01 * step, 0.0, 0.0)),
        lambda step: costmap.snapshot().costs.sum(),
        lambda step: costmap.clear(),
    ]
    threads = [threading.Thread(target=guarded, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []


# --- values changed while it runs

def seen(change=None):
    """Return a local costmap that saw one obstacle and is up to date."""
    costmap = factory.build_costmap("local_costmap", {**NEW_FORM, **(change or {})})
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.6, 0.0]]), None, 0.0))
    costmap.update(0.0, IDENTITY)
    return costmap


@pytest.mark.parametrize("layer, change", [
    ("inflation", {"inflation_radius": 0.3}),
    ("inflation", {"cost_scaling_factor": 12.0}),
    ("inflation", {"enabled": False}),
    ("obstacles", {"enabled": False}),
    ("obstacles", {"combination_method": 99}),
])
def test_a_layer_changed_while_it_runs_is_as_one_made_so(layer, change):
    costmap = seen()
    before = costmap.snapshot()
    costmap.reconfigure_layer(layer, costmap.layer(layer).parameters.replace(**change))
    assert (costmap.snapshot().costs == before.costs).all()  # it shows with the next update, not sooner
    costmap.update(0.1, IDENTITY)
    made_so = seen({layer: {**NEW_FORM[layer], **change}})
    assert (costmap.snapshot().costs == made_so.snapshot().costs).all()
    assert (costmap.snapshot().costs != before.costs).any()
    costmap.reconfigure_layer(layer, seen().layer(layer).parameters)
    costmap.update(0.2, IDENTITY)
    assert (costmap.snapshot().costs == before.costs).all()


@pytest.mark.parametrize("change", [
    {"width": 4.0, "height": 2.0}, {"resolution": 0.1}, {"robot_radius": 0.2}, {"footprint_padding": 0.05},
    {"footprint": "[[-0.2, -0.1], [-0.2, 0.1], [0.3, 0.1], [0.3, -0.1]]"}, {"origin_x": 7.0},
])
def test_a_window_changed_while_it_runs_is_as_one_made_so(change):
    costmap = seen()
    before = costmap.snapshot()
    costmap.reconfigure(costmap.parameters.replace(**change))
    assert costmap.snapshot().grid == before.grid
    costmap.update(0.1, IDENTITY)
    made_so = seen(change).snapshot()
    snapshot = costmap.snapshot()
    assert snapshot.grid.shape == made_so.grid.shape and snapshot.grid.resolution == made_so.grid.resolution
    assert snapshot.grid.origin_x == pytest.approx(made_so.grid.origin_x, abs=1e-9)
    assert snapshot.grid.origin_y == pytest.approx(made_so.grid.origin_y, abs=1e-9)
    assert (snapshot.costs == made_so.costs).all()
    assert (snapshot.footprint == made_so.footprint).all() and snapshot.inscribed_radius == made_so.inscribed_radius


def test_a_footprint_that_came_by_topic_stays_until_a_parameter_asks_for_another():
    costmap = seen()
    square = np.array([[-0.3, -0.3], [-0.3, 0.3], [0.3, 0.3], [0.3, -0.3]])
    costmap.set_footprint(square)
    costmap.reconfigure(costmap.parameters.replace(transform_tolerance=1.0))
    assert (costmap.outline == square).all()
    costmap.reconfigure(costmap.parameters.replace(footprint_padding=0.1))
    assert costmap.footprint == pytest.approx(np.sign(square) * 0.4)
    costmap.reconfigure(costmap.parameters.replace(robot_radius=0.2))
    assert costmap.outline.shape == (16, 2)


def test_a_footprint_of_a_house_is_refused_instead_of_taking_all_memory():
    """At nine metres to each side the server stood for half a minute, over 2.6 GiB of headings drawn beforehand."""
    costmap = seen({"width": 3.0, "height": 3.0, "resolution": 0.025})
    house = np.array([[9.0, 9.0], [9.0, -9.0], [-9.0, -9.0], [-9.0, 9.0]])
    with pytest.raises(ValueError, match="reaches 12.73 m from the base frame, 509 cells of 0.025 m; at most 400"):
        costmap.parameters.replace(footprint=house.tolist())
    with pytest.raises(ValueError, match="reaches 14.24 m from the base frame, 570 cells of 0.025 m; at most 400"):
        costmap.parameters.replace(footprint_padding=10.0)
    costmap.reconfigure(costmap.parameters.replace(footprint=(0.5 * house).tolist()))


@pytest.mark.parametrize("side, changes, complaint", [
    (0.15, {"footprint_padding": -0.2}, "inside out"),
    (0.35, {"resolution": 0.001, "width": 1.0, "height": 1.0}, "at most 400"),
])
def test_an_outline_that_came_by_topic_is_not_padded_inside_out_either(side, changes, complaint):
    """The parameters were judged by the outline that they name, of another robot, and the one in force was padded."""
    costmap = seen({"width": 3.0, "height": 3.0, "resolution": 0.025, "robot_radius": 0.3})
    costmap.set_footprint(np.array([[side, side], [side, -side], [-side, -side], [-side, side]]))
    before, footprint = costmap.parameters, costmap.footprint
    with pytest.raises(ValueError, match=complaint):
        costmap.reconfigure(before.replace(**changes))
    assert costmap.parameters == before and np.array_equal(costmap.footprint, footprint)


@pytest.mark.parametrize("padding", [-0.09, -5.0])
def test_a_robot_is_not_padded_inside_out(padding):
    """At -0.09 the burger drove as a strip behind its own wheels, at -5 it was ten metres long and stood for good."""
    with pytest.raises(ValueError, match=f"footprint_padding is {padding:g} m; it would turn a footprint inside out"):
        seen({"footprint": [[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]],
              "footprint_padding": padding})
    slimmer = seen({"footprint": [[-0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [0.1, -0.1]], "footprint_padding": -0.04})
    assert np.abs(slimmer.footprint) == pytest.approx(0.06)
    assert seen({"robot_radius": 0.2, "footprint_padding": -0.04}).footprint.max() == pytest.approx(0.16)


def test_what_a_map_gave_the_costmap_cannot_be_changed():
    costmap = factory.build_costmap("global_costmap", OLD_FORM_GLOBAL)
    costmap.set_map(room())
    with pytest.raises(ValueError, match="global_costmap has the size"):
        costmap.reconfigure(costmap.parameters.replace(width=5.0))
    costmap.reconfigure(costmap.parameters.replace(update_frequency=2.0))
    costmap.update(1.0, IDENTITY)
    assert costmap.snapshot().grid.shape == (80, 80)
    assert costmap.parameters.width == 10.0 and costmap.parameters.update_frequency == 2.0


def test_a_map_that_comes_before_a_wanted_size_is_taken_up_wins():
    costmap = factory.build_costmap("global_costmap", OLD_FORM_GLOBAL)
    costmap.reconfigure(costmap.parameters.replace(width=5.0))
    costmap.set_map(room())
    costmap.update(1.0, IDENTITY)
    assert costmap.snapshot().grid.shape == (80, 80)


def test_no_robot_is_planned_through_walls_between_a_larger_map_and_the_next_update():
    """The costmap was free all over, or unknown, until then: a map grows with each room a SLAM node sees."""
    costmap = factory.build_costmap("global_costmap", OLD_FORM_GLOBAL)
    costmap.set_map(room())
    costmap.update(1.0, IDENTITY)
    before = costmap.snapshot()
    costmap.set_map(room(120))
    assert np.array_equal(costmap.snapshot().costs, before.costs)
    costmap.update(1.1, IDENTITY)
    assert costmap.snapshot().grid.shape == (120, 120) and (costmap.snapshot().costs[0] == LETHAL).all()


@pytest.mark.parametrize("change", [{"width": 0.04}, {"height": 0.04}, {"resolution": 4.0}, {"width": 2000.0}])
def test_a_size_without_cells_or_with_too_many_is_refused(change):
    with pytest.raises(ValueError, match="must be a cell at least|cells; at most 32767 each way"):
        seen().parameters.replace(**change)
