"""What the one-process move_base tells its relay of the plugins in use."""

import pytest

pytest.importorskip("dynamic_reconfigure", reason="there is no ROS for this interpreter")

from mbf_relay.navigation.move_base_files import server_config  # noqa: E402
from mbf_relay.navigation.move_base_parameters import MoveBaseParameters  # noqa: E402
from mbf_relay.ros.move_base.node import with_own_server  # noqa: E402
from mbf_relay.ros.move_base.settings import OwnSettings  # noqa: E402
from mbf_relay.ros.relay.relay import RelayParameters  # noqa: E402


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
