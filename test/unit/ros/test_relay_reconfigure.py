"""move_base's parameters and the server's."""

import pytest

pytest.importorskip("dynamic_reconfigure.encoding")

from mbf_relay.ros.relay_reconfigure import MoveBaseParameters, plugin_name, server_changes  # noqa: E402

PLUGINS = [{"name": "NavfnROS", "type": "navfn/NavfnROS"}, {"name": "other", "type": "global_planner/GlobalPlanner"}]


def test_only_changes_are_forwarded_under_the_servers_names():
    old = MoveBaseParameters()
    new = old.replace(max_planning_retries=3, recovery_behavior_enabled=False, planner_patience=5.0)
    assert server_changes(old, new) == {"planner_max_retries": 3, "recovery_enabled": False}
    assert server_changes(new, new) == {}


def test_what_the_server_has_nothing_like_is_not_forwarded():
    old = MoveBaseParameters()
    new = old.replace(conservative_reset_dist=1.0, clearing_rotation_allowed=False, make_plan_clear_costmap=False,
                      make_plan_add_unreachable_goal=False, base_local_planner="dwa_local_planner/DWAPlannerROS")
    assert server_changes(old, new) == {}


@pytest.mark.parametrize("wanted, name", [
    ("navfn/NavfnROS", "NavfnROS"), ("global_planner/GlobalPlanner", "other"), ("other", "other"),
    ("carrot_planner/CarrotPlanner", None), ("GlobalPlanner", None), ("", None),
])
def test_a_plugins_type_becomes_the_servers_name_for_it(wanted, name):
    assert plugin_name(wanted, PLUGINS) == name
    assert plugin_name(wanted, []) is None


@pytest.mark.parametrize("values, allowed", [({"planner_frequency": -1.0}, "at least 0"), ({"oscillation_timeout": 61.0}, "at most 60")])
def test_ranges_are_move_bases(values, allowed):
    with pytest.raises(ValueError, match=allowed):
        MoveBaseParameters(**values)
