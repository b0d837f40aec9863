"""move_base's parameters and the server's."""

import threading
import xmlrpc.client

import pytest
from ros_testing import wait_until

pytest.importorskip("dynamic_reconfigure.encoding")

from mbf_relay.navigation.move_base_parameters import MoveBaseParameters  # noqa: E402
from mbf_relay.ros.relay import reconfigure as relay_reconfigure  # noqa: E402
from mbf_relay.ros.relay.reconfigure import MoveBaseSettings, name_at_server, server_changes, wishes  # noqa: E402

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
    assert name_at_server(wanted, PLUGINS) == name
    assert name_at_server(wanted, []) is None


@pytest.mark.parametrize(
    "values, allowed", [({"planner_frequency": -1.0}, "at least 0"), ({"oscillation_timeout": 61.0}, "at most 60")]
)
def test_ranges_are_move_bases(values, allowed):
    with pytest.raises(ValueError, match=allowed):
        MoveBaseParameters(**values)


def test_what_a_killed_relay_only_showed_is_nobody_s_wish():
    left = {"planner_frequency": 5.0, "oscillation_timeout": 7.0, "controller_frequency": 12.0,
            "mirrored": {"planner_frequency": 5.0, "controller_frequency": 10.0}}
    assert wishes(left) == {"oscillation_timeout": 7.0, "controller_frequency": 12.0}, (
        "somebody has changed the last since"
    )
    assert wishes({"planner_frequency": 5.0}) == {"planner_frequency": 5.0}
    assert wishes({"planner_frequency": 5.0, "mirrored": "nonsense"}) == {"planner_frequency": 5.0}


def test_a_master_that_hangs_keeps_no_goal_and_so_no_cancel_waiting(monkeypatch):
    def hang(*_arguments):
        raise AssertionError("the master was asked while a goal waited")

    monkeypatch.setattr("rospy.resolve_name", lambda name: "/" + name)
    monkeypatch.setattr("rospy.get_param", hang)
    settings = MoveBaseSettings(
        "move_base_flex", MoveBaseParameters(base_global_planner="global_planner/GlobalPlanner")
    )
    settings.server_came()
    assert settings.plugin_names() == ("", "") and not settings.knows_server
    assert MoveBaseSettings("move_base_flex", MoveBaseParameters()).knows_server


@pytest.mark.parametrize("answer", [ConnectionRefusedError(), xmlrpc.client.Fault(1, "changed during iteration")])
def test_goals_are_sent_though_the_master_could_not_say_at_first_what_plugins_the_server_has(monkeypatch, answer):
    answers, ends = [answer], []

    def get_param(name, _default):
        if answers:
            raise answers.pop()
        return PLUGINS if name.endswith("planners") else []

    for name, stand_in in {
        "get_param": get_param, "resolve_name": lambda name: "/" + name, "is_shutdown": lambda: bool(ends),
        "ServiceProxy": lambda *_: None, "logwarn": lambda *_: None,
    }.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    monkeypatch.setattr(relay_reconfigure, "RETRY_AFTER", 0.01)
    settings = MoveBaseSettings(
        "move_base_flex", MoveBaseParameters(base_global_planner="global_planner/GlobalPlanner"))
    settings.server_came()
    worker = threading.Thread(target=settings._forward, daemon=True)
    worker.start()
    wait_until(lambda: settings.knows_server, "the server's plugins", 5.0)
    assert settings.plugin_names() == ("other", "")
    ends.append(True)
    settings._wake.set()
    worker.join(5.0)
