"""What the one-process move_base tells its relay of the plugins in use."""

from types import SimpleNamespace

import pytest
import rospy

from mbf_relay.navigation.move_base_files import server_config
from mbf_relay.navigation.move_base_parameters import MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.move_base import node
from mbf_relay.ros.move_base.node import MoveBaseServer, with_own_server
from mbf_relay.ros.move_base.settings import OwnSettings
from mbf_relay.ros.relay.relay import RelayParameters


@pytest.mark.parametrize("namespace", [
    {},
    {"base_local_planner": "dwa_local_planner/DWAPlannerROS", "base_global_planner": "global_planner::GlobalPlanner"},
    {"base_local_planner": "nav_core_adapter::LocalPlannerAdapter",
     "LocalPlannerAdapter": {"planner_name": "dwb_local_planner::DWBLocalPlanner"}},
])
def test_goals_name_plugins_as_the_server_beside_loads_them(namespace):
    values = MoveBaseParameters.read(namespace)[0]
    config = server_config(namespace, values)
    loaded = tuple(config[kind][0]["name"] for kind in ("planners", "controllers"))
    assert OwnSettings(values, namespace).plugin_names() == loaded


def test_a_robot_with_a_goal_tolerance_of_a_metre_is_told_to_have_arrived_as_by_move_base():
    """Each of its goals was aborted as not reached: the relay knew better than the controller of its own process."""
    assert with_own_server(RelayParameters(), "map").arrival_tolerance >= 1000.0


def test_patience_that_is_taken_away_at_run_time_is_one_try_and_comes_back():
    settings = OwnSettings(MoveBaseParameters(), {"controller_max_retries": 7})
    server = SimpleNamespace(navigator=SimpleNamespace(parameters=NavigatorParameters(controller_max_retries=7)))
    server.reconfigure = lambda parameters: setattr(server.navigator, "parameters", parameters)
    settings._server = server
    none = {"planner_patience": 0.0, "controller_patience": 0.0}
    for changes, patience, retries in ((none, (5.0, 5.0), (0, 0)), ({}, (5.0, 5.0), (-1, 7))):
        settings._change(MoveBaseParameters(**changes))
        made = server.navigator.parameters
        assert (made.planner_patience, made.controller_patience) == patience
        assert (made.planner_max_retries, made.controller_max_retries) == retries


def test_a_node_that_is_interrupted_while_it_waits_for_a_map_does_not_say_that_it_is_here(monkeypatch):
    """Nor does it go on to offer what it has; Ctrl-C was answered by "move_base is here"."""
    server = MoveBaseServer.__new__(MoveBaseServer)
    server._server, server.settings = SimpleNamespace(start=lambda: None), SimpleNamespace(serve=lambda _server: None)
    server._nodes = {"global": SimpleNamespace(missing_input=lambda: "a map")}
    looks = iter([False, False, True])
    monkeypatch.setattr(node.rospy, "is_shutdown", lambda: next(looks))
    with pytest.raises(rospy.ROSInterruptException):
        server.start()
