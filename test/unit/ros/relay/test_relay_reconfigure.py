"""move_base's parameters and the server's."""

import threading
import xmlrpc.client

import pytest
from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.srv import ReconfigureResponse
from ros_testing import wait_until

from mbf_relay.navigation.move_base_parameters import MoveBaseParameters
from mbf_relay.navigation.parameters import DYNAMIC, NavigatorParameters
from mbf_relay.ros.relay import reconfigure as relay_reconfigure
from mbf_relay.ros.relay.reconfigure import MoveBaseSettings, name_at_server, server_changes, wishes

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


def test_whoever_names_a_planner_that_the_server_has_not_is_told_which_one_drives_the_robot(monkeypatch):
    """The log said what there was, and not that the robot went by another planner than its file names."""
    said = []
    for name, stand_in in {"resolve_name": lambda name: "/" + name, "get_param": lambda _name, _default: PLUGINS,
                           "logwarn": lambda text, *values: said.append(text % values)}.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    settings = MoveBaseSettings("move_base_flex", MoveBaseParameters(base_global_planner="my/Planner"))
    settings.server_came()
    settings.send_wishes(None)
    assert settings.plugin_names() == ("", "") and settings.knows_server
    assert len(said) == 1 and said[0].startswith("/move_base_flex has no plugin 'my/Planner'; it has: ")
    assert said[0].endswith("; goals get its default")


def test_no_goal_is_composed_while_the_server_s_plugins_are_being_learned(monkeypatch):
    """Sent between the two lists, a goal that waited for the server was driven to by another controller than asked for.
    """
    composed = []

    def get_param(name, _default):
        if settings.knows_server:
            composed.append(settings.plugin_names())
        return PLUGINS if name.endswith("planners") else [
            {"name": "first", "type": "eband/EBand"}, {"name": controller, "type": "dwa_local_planner/DWAPlannerROS"}]

    monkeypatch.setattr("rospy.resolve_name", lambda name: "/" + name)
    monkeypatch.setattr("rospy.get_param", get_param)
    settings = MoveBaseSettings("move_base_flex", MoveBaseParameters(
        base_global_planner="global_planner/GlobalPlanner", base_local_planner="dwa_local_planner/DWAPlannerROS"))
    for controller in "DWAPlannerROS", "dwa":  # a server that takes the place of another has names of its own
        settings.server_came()
        settings.send_wishes(lambda _config: pytest.fail("nothing was wished for"))
        assert settings.knows_server and settings.plugin_names() == ("other", controller)
    assert composed == []


class PaperServer:
    """The server's set_parameters: takes what is within its ranges or, as ours, nothing of what comes together."""

    def __init__(self):
        self.values = NavigatorParameters()

    def __call__(self, config):
        try:
            self.values = self.values.replace(**decode_config(config))
        except ValueError:
            pass
        return ReconfigureResponse(encode_config({name: getattr(self.values, name) for name in DYNAMIC}))


class PaperFront:
    """The relay's own reconfigure server."""

    def __init__(self):
        self.shown = {}

    def update_configuration(self, values):
        self.shown.update(values)


def test_no_patience_is_one_try_at_the_server_and_not_patience_for_ever(monkeypatch):
    """A robot whose goal lay in a wall stood there for good: none is endless to the server, and one plan to move_base.
    """
    server = PaperServer()
    for name, stand_in in {"resolve_name": lambda name: "/" + name, "loginfo": lambda *_: None,
                           "set_param": lambda *_: None, "get_param": lambda _name, default: default}.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    none = MoveBaseParameters(planner_patience=0.0, controller_patience=0.0)
    settings = MoveBaseSettings("move_base_flex", none)
    settings._dynamic = PaperFront()
    settings.server_came()
    settings.send_wishes(server)
    for wish, retries in ((none, 0), (MoveBaseParameters(), -1), (none, 0)):
        settings._change(wish)
        settings.send_wishes(server)
        made = server.values
        assert (made.planner_max_retries, made.controller_max_retries) == (retries, retries)
        assert made.planner_patience > 0.0 and made.controller_patience > 0.0
        settings._show({name: getattr(made, name) for name in DYNAMIC})
        assert settings.values == wish, "it shows as it was set"


def test_a_rate_the_server_refuses_keeps_no_other_wish_from_it_at_its_next_start(monkeypatch):
    """A robot whose server was started again recovered, though that was switched off: 0 Hz came with it each time."""
    server, mirrored = PaperServer(), []
    for name, stand_in in {"resolve_name": lambda name: "/" + name, "logwarn": lambda *_: None,
                           "loginfo": lambda *_: None, "get_param": lambda _name, default: default,
                           "set_param": lambda _name, value: mirrored.append(value)}.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    settings = MoveBaseSettings("move_base_flex", MoveBaseParameters(recovery_behavior_enabled=False))
    settings._dynamic = PaperFront()
    for wish in (settings.values, settings.values.replace(controller_frequency=0.0)):
        settings._change(wish)
        settings.send_wishes(server)
    assert settings.values.controller_frequency == settings._dynamic.shown["controller_frequency"] == 20.0
    assert "controller_frequency" in mirrored[-1], "nobody's wish, for the next relay"
    settings.server_came()
    server.values = NavigatorParameters()
    settings.send_wishes(server)
    assert not server.values.recovery_enabled and server.values.controller_frequency == 20.0


def test_a_rate_somebody_changes_takes_back_nothing_the_server_was_given_meanwhile(monkeypatch):
    """It was first undone at the server, and then the relay's wish, by which the server's file meant nothing any more.
    """
    monkeypatch.setattr("rospy.resolve_name", lambda name: "/" + name)
    monkeypatch.setattr("rospy.set_param", lambda *_: None)
    settings, front = MoveBaseSettings("move_base_flex", MoveBaseParameters()), MoveBaseParameters()
    asked = []

    class LateFront:
        """A reconfigure server that is busy with a request when it is told of the server's values."""

        @staticmethod
        def update_configuration(values):
            settings._change(front.replace(controller_frequency=15.0))
            settings._change(front.replace(controller_frequency=15.0, **values))

    settings._dynamic = LateFront()
    settings._mirror(encode_config({"planner_frequency": 2.0}))
    monkeypatch.setattr("rospy.loginfo", lambda *_: None)
    settings.send_wishes(lambda config: asked.append(decode_config(config)) or ReconfigureResponse(config))
    assert asked == [{"controller_frequency": 15.0}]
    assert (settings.values.planner_frequency, settings.values.controller_frequency) == (2.0, 15.0)
