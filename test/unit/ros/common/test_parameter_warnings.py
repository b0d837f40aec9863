"""Names in a user's file that nobody reads are told of, whoever should have read them."""

import pytest
import rospy
from rosmaster.paramserver import ParamDictionary

from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.navigation.examination import READ_BY_THE_NODE, SIDES
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.registry import Registry
from mbf_relay.planning.planner import Planner
from mbf_relay.ros.common import parameters
from mbf_relay.ros.server import node


@pytest.fixture
def said(monkeypatch):
    lines = []
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: lines.append(text % values))
    monkeypatch.setattr(rospy, "loginfo", lambda text, *values: None)
    return lines


def test_a_misspelt_parameter_of_a_plugin_is_told_of(said):
    config = {
        "planners": [{"name": "navfn", "type": "navfn/NavfnROS"}],
        "navfn": {"alow_unknown": False, "default_tolerance": 0.1},
    }
    known = {"navfn/NavfnROS": "mbf_relay.planning.navfn.NavfnPlanner"}
    node._log_plugins(Registry("planners", config, Planner, known, None, "global"))
    assert len(said) == 1
    assert "navfn/alow_unknown" in said[0] and "'allow_unknown'" in said[0]


def test_an_older_name_of_a_plugin_s_parameter_is_told_of(said):
    parameters.warn_of_unknown(DwaParameters, {"max_trans_vel": 0.2, "max_vel_x": 0.2}, "~DWAPlannerROS")
    assert len(said) == 1
    assert "DWAPlannerROS/max_trans_vel" in said[0] and "'max_vel_trans'" in said[0]


def test_parameters_under_a_name_no_plugin_has_are_told_of(said):
    config = {
        "DWAPlanerROS": {"max_vel_x": 0.2},
        "DWAPlannerROS": {},
        "local_costmap": {},
        "global_costmp": {},
        "planners": [],
    }
    node._warn_of_stray_groups(config, ["DWAPlannerROS"])
    assert len(said) == 2
    assert "DWAPlanerROS" in said[0] and "'DWAPlannerROS'" in said[0]
    assert "global_costmp" in said[1] and "'global_costmap'" in said[1]


def test_a_group_where_a_plugin_s_number_belongs_is_told_of(said):
    parameters.warn_of_unknown(DwaParameters, {"max_vel_xx": {"a": 1}, "max_vel_x": 0.2}, "~DWAPlannerROS")
    assert len(said) == 1
    assert "DWAPlannerROS/max_vel_xx" in said[0] and "'max_vel_x'" in said[0]


def test_a_group_where_a_node_s_number_belongs_is_told_of(said):
    values = {"laser_max_rnge": {"a": 1}, "odom_alpha1": 0.1, "cloud": {"selective_resampling": True}}
    parameters.warn_of_unknown(AmclParameters, values, "~", ["cloud"])
    assert len(said) == 1
    assert "laser_max_rnge" in said[0] and "'laser_max_range'" in said[0]


@pytest.mark.parametrize("standing, node, told", [
    (["/amcl/seed", "/planners", "/global_costmap/footprint", "/local_costmap/width"], "/move_base_flex", True),
    (["/robot1/planners", "/robot1/controllers", "/robot1/robot_frame"], "/robot1/move_base_flex", True),
    (["/robot1/planners", "/robot1/controllers", "/robot1/robot_frame"], "/move_base_flex", False),
    ([f"/move_base_flex/{name}" for name in ("planners", "controllers", "robot_frame")], "/move_base_flex", False),
    (["/robot_frame", "/map_frame", "/robot_description", "/use_sim_time"], "/move_base_flex", False),
])
def test_a_node_s_own_file_given_as_overrides_is_told_of(said, monkeypatch, standing, node, told):
    """The robot drove by the footprint and the speeds of another, and nothing told that the file was not read."""
    monkeypatch.setattr(rospy, "get_param_names", lambda: standing)
    monkeypatch.setattr(rospy, "get_name", lambda: node)
    monkeypatch.setattr(rospy, "get_namespace", lambda: node.rpartition("/")[0] + "/")
    parameters.warn_of_own_file_beside((*NavigatorParameters.names(), *READ_BY_THE_NODE, *SIDES))
    assert [("'move_base_flex:'" in text, f"beside {node}" in text) for text in said] == [(True, True)] * told


@pytest.mark.parametrize("place, frame, told", [
    ("/robot1/tf_prefix", "base_link", "/robot1/tf_prefix"),
    ("/robot1/amcl/tf_prefix", "base", "/robot1/amcl/tf_prefix"),
    ("/tf_prefix", "robot10/base_link", "/tf_prefix"), ("/robot1/tf_prefix", "robot1/base_link", ""),
    ("/robot2/tf_prefix", "base_link", ""), ("/robot1/move_base/tf_prefix", "base_link", "")])
def test_who_counts_on_a_tf_prefix_is_told_that_frames_are_to_be_named_with_it(said, monkeypatch, place, frame, told):
    """It waited in silence for the frames of a robot whose state publisher alone pays heed to it."""
    there = ParamDictionary(None)
    there.set_param("/use_sim_time", True)
    there.set_param(place, "/robot1")
    monkeypatch.setattr(rospy, "search_param", lambda name: there.search_param("/robot1/amcl", name))
    monkeypatch.setattr(rospy, "get_param", lambda name, default: there.get_param(name))
    parameters.warn_of_tf_prefix(frame)
    assert [line.split()[0] for line in said] == [told] * bool(told)
    assert not told or f"'robot1/{frame}'" in said[0]
