"""What is told of a parameter file before anything is driven by it."""

import copy

import pytest

from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.navigation.examination import (
    CLAMPED,
    DOUBTFUL,
    IGNORED,
    KINDS,
    REFUSED,
    STOOD_IN,
    USED,
    examine_move_base,
    examine_server,
    examine_set,
    names_a_plugin,
    stray_groups,
)

SERVER = {
    "planners": [{"name": "navfn", "type": "navfn/NavfnROS"}],
    "controllers": [{"name": "dwa", "type": "dwa_local_planner/DWAPlannerROS"}],
    "recovery_behaviors": [{"name": "turn", "type": "rotate_recovery/RotateRecovery"}],
    "local_costmap": {"robot_radius": 0.2, "rolling_window": True, "observation_sources": "scan", "scan": {}},
    "global_costmap": {"robot_radius": 0.2},
    "dwa": {"max_vel_x": 0.3, "max_vel_y": 0.0}, "navfn": {}, "turn": {},
}


def told_of(changes, examine=examine_server):
    """Return what is told besides what is used, of a server's file with changes, by the names it is about."""
    values = copy.deepcopy(SERVER)
    for name, value in changes.items():
        group, _, last = name.rpartition("/")
        (values[group] if group else values)[last] = value
    return {finding.name: (finding.kind, finding.text) for finding in examine(values).findings if finding.kind != USED}


def test_of_a_sound_file_is_told_what_is_used_alone():
    found = examine_server(SERVER)
    assert {finding.kind for finding in found.findings} == {USED} and found.config == SERVER
    names = [finding.name for finding in found.of(USED)]
    assert {"navfn", "dwa", "turn", "local_costmap/inflation_layer"} <= set(names)
    assert found.of(*KINDS) == found.findings
    assert told_of({"planner_lock_costmap": True, "restore_defaults": False, "dwa/restore_defaults": False}) == {}


@pytest.mark.parametrize("name, kind, text", [
    ("planner_frequenc", IGNORED, "is not known here; did you mean 'planner_frequency'?"),
    ("dwa/max_vel_xx", IGNORED, "is not known here; did you mean 'max_vel_x'?"),
    ("local_costmap/inflation_radus", IGNORED, "is not known here; did you mean 'inflation_radius'?"),
    ("controller_frequency", CLAMPED, "parameter controller_frequency is 1000.0"),
    ("local_costmap/obstacle_rang", IGNORED, "is not known here; did you mean 'obstacle_range'?"),
    ("local_costmap/update_frequenc", IGNORED, "is not known here; did you mean 'update_frequency'?"),
    ("local_costmap/scam", IGNORED, "is not known here; did you mean 'scan'?"),
    ("dwa/max_vel_x", DOUBTFUL, "speeds are in m/s"),
])
def test_what_is_said_is_of_the_parameter_it_is_about(name, kind, text):
    known = told_of({name: 1000})
    assert known[name][0] == kind and text in known[name][1], known


@pytest.mark.parametrize("changes, name, text", [
    ({"dwa/max_vel_x": "fast"}, "dwa/max_vel_x", "'fast'"),
    ({"controller_frequency": "often"}, "controller_frequency", "'often'"),
    ({"planners": 3}, "planners", "it must be a list"),
    ({"planners": [{"name": "navfn", "type": "no/Such"}]}, "navfn", "no/Such"),
    ({"local_costmap": 3}, "local_costmap", "must be a group"),
    ({"local_costmap/resolution": 1e6}, "local_costmap/resolution", "resolution is 1000000.0"),
    ({"global_costmap/plugins": [{"name": "odd", "type": "no::Layer"}]}, "global_costmap/odd", "the layer is left out"),
])
def test_what_keeps_it_from_starting_is_refused_by_name(changes, name, text):
    known = told_of(changes)
    assert known[name][0] == REFUSED and text in known[name][1], known


@pytest.mark.parametrize("changes, name, kind, text", [
    ({"dwa/vx_samples": -3}, "dwa/vx_samples", CLAMPED, "vx_samples is -3"),
    ({"local_costmap/width": -3.0}, "local_costmap/width", CLAMPED, "local_costmap: parameter width is -3.0"),
    ({"controllers": [{"name": "dwa", "type": "teb_local_planner/TebLocalPlannerROS"}]}, "dwa", STOOD_IN,
     "not available here"),
])
def test_what_is_taken_to_a_range_and_what_is_stood_in_for_is_told(changes, name, kind, text):
    known = told_of(changes)
    assert known[name][0] == kind and text in known[name][1], known


@pytest.mark.parametrize("changes, name, kind", [
    ({"dwa/prune_plan": True}, "dwa/prune_plan", IGNORED),
    ({"dwa/prune_plan": False}, "dwa/prune_plan", None),  # the default: nothing is lost
    ({"navfn/planner_window_x": 10.0}, "navfn/planner_window_x", None),  # nor is anything lost with it
    ({"force_stop_at_goal": True}, "force_stop_at_goal", IGNORED),
    ({"local_costmap/plugins": [{"name": "sonar", "type": "range_sensor_layer::RangeSensorLayer"}],
      "local_costmap/sonar": {"input_sensor_type": "FIXED"}}, "local_costmap/sonar/input_sensor_type", IGNORED),
])
def test_who_sets_what_is_without_effect_is_told(changes, name, kind):
    told = told_of(changes).get(name)
    assert (None if told is None else told[0]) == kind
    assert told is None or told[1].startswith("is read, and without effect:")


def test_of_amcl_s_parameters_none_is_called_used_that_is_without_effect():
    found = examine_set(AmclParameters, {"gui_publish_rate": 50.0, "max_particles": 300})
    kinds = {each.name: each.kind for each in found.findings}
    assert kinds == {"gui_publish_rate": IGNORED, "max_particles": USED}


@pytest.mark.parametrize("examine", [examine_server, examine_move_base])
@pytest.mark.parametrize("side, follows", [
    ("local_costmap", "so that nothing is seen there"), ("global_costmap", "so that paths are planned without the map"),
])
def test_a_robot_whose_costmap_s_file_was_not_loaded_is_not_called_sound(examine, side, follows):
    """It saw nothing and drove into what was not on the map, or planned through the walls that are on it."""
    found = examine({name: values for name, values in SERVER.items() if name != side})
    (text,) = [finding.text for finding in found.of(DOUBTFUL) if finding.name == side]
    assert f"is not given, {follows}" in text
    assert not [finding for finding in examine(SERVER).of(DOUBTFUL) if finding.name == side]


def test_a_layer_that_sees_nothing_is_not_called_a_robot_that_does():
    """A robot's keep-out areas were never marked, as their group was called otherwise than their layer."""
    layers = [{"name": name, "type": "costmap_2d::ObstacleLayer"} for name in ("robots", "keep_out_area")]
    group = {"observation_sources": "points", "points": {"data_type": "PointCloud2", "topic": "points"}}
    told = told_of({"local_costmap/plugins": layers, "local_costmap/robots": group,
                    "local_costmap/keep_out_area_layer": group})
    kind, text = told["local_costmap/keep_out_area/observation_sources"]
    assert (kind, text.split(";")[:2]) == (DOUBTFUL, [
        "is not given, so that the layer marks nothing",
        " there is a group 'keep_out_area_layer', and no layer of that name"])


def test_an_old_name_is_told_with_the_present_one():
    values = {**copy.deepcopy(SERVER), "dwa": {"max_trans_vel": 0.3}}
    told = [(each.kind, each.text) for each in examine_server(values).findings if each.name == "dwa/max_trans_vel"]
    assert told == [(CLAMPED, "has an old name; 'max_vel_trans' is the present one")]


def test_of_what_is_refused_it_is_not_told_that_it_is_ignored_as_well():
    values = {**copy.deepcopy(SERVER), "planners": [{"name": "navfn", "type": "no/Such"}], "navfn": {"a": 1}}
    assert [finding.kind for finding in examine_server(values).findings if finding.name == "navfn"] == [REFUSED]


def test_a_group_of_no_plugin_is_told_of_with_the_plugin_it_may_be_meant_for():
    known = told_of({"dwaa": {"max_vel_x": 0.1}, "teb": {"max_vel_x": 0.1}})
    assert known["dwaa"] == (IGNORED, "belongs to no plugin that is loaded; did you mean 'dwa'?")
    assert known["teb"] == (IGNORED, "belongs to no plugin that is loaded")
    assert stray_groups({"a/b": {}, "a": {}, "local_costmap": {}, "x": 3, "DWAPlannerROS": {}, "y": {}}, ["a/b"]) == {
        "DWAPlannerROS": "", "y": ""}


def test_who_has_chosen_another_controller_is_not_warned_of_the_parameters_of_those_he_left():
    """The log of a car by its own file, which has MPPI alone, warned twice of what stands in the burger's."""
    known = [*SERVER, "DWAPlannerROS", "PurePursuit", "MPPI", "TrajectoryPlannerROS", "NavfnROS"]
    assert [name for name in known if names_a_plugin(name)] == known[len(SERVER):]
    assert not any(names_a_plugin(name) for name in ("DWAPlanerROS", "ROS", "Planners", "dwaa", ""))


def test_move_base_s_own_names_are_told_of_alike_and_others_may_be_known_elsewhere():
    values = {"local_costmap": SERVER["local_costmap"], "global_costmap": SERVER["global_costmap"]}
    found = examine_move_base({**values, "base_local_planer": "x", "mine": 3, "planner_frequency": -1.0}, ["mine"])
    told = {finding.name: finding.text for finding in found.findings if finding.kind in (IGNORED, CLAMPED)}
    assert "did you mean 'base_local_planner'?" in told["base_local_planer"] and "mine" not in told
    assert "planner_frequency is -1.0" in told["planner_frequency"] and "controllers" in found.config
    refused = examine_move_base({**values, "planner_frequency": "often"})
    assert [(each.kind, each.name) for each in refused.findings] == [(REFUSED, "planner_frequency")]
    assert refused.config == {}


@pytest.mark.parametrize("kind", ["costmap_2d::FetchDepthLayer", "my_layers::ObstacleLayer", "ObstacleLayer"])
def test_a_robot_with_a_layer_of_another_name_that_sees_nothing_is_not_called_sound(kind):
    """A layer in the place of one that is not here took a sensor nobody had described, and that was not told."""
    told = told_of({"local_costmap/plugins": [{"name": "seen", "type": kind}],
                    "local_costmap/seen": {"observation_sources": "lidar"}})
    assert told["local_costmap/seen/lidar"] == (
        DOUBTFUL, "is not given, so that source 'lidar' is a PointCloud on topic 'lidar'")
    told = told_of({"local_costmap/plugins": [{"name": "seen", "type": 5}]})
    assert told["local_costmap"] == (REFUSED, "local_costmap: layer 'seen': its type is 5; it must be a text")
