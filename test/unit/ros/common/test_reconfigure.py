"""What rqt_reconfigure shows is what it shows of upstream's nodes: names, types, defaults and the ends of sliders."""

import sys
import threading
import types
import xmlrpc.server
from types import SimpleNamespace

import pytest
import rospy
from upstream_parameters import CONFIG, DIFFERENT, README, SECTION, UPSTREAM, offered, table

from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.navigation.parameters import NavigatorParameters

SPEEDS = ("max_vel_x", "max_vel_trans", "min_vel_trans")


def differing(name, parameter):
    """Return what is another here, by "type", "low" or "high"."""
    return DIFFERENT.get(name, {}).get(parameter, {})


@pytest.mark.parametrize("name", sorted(UPSTREAM))
def test_names_types_and_defaults_are_upstream_s(name):
    found = offered(name)
    for parameter, (kind, default, _low, _high) in UPSTREAM[name].items():
        assert found[parameter][:2] == (differing(name, parameter).get("type", kind), default), parameter


@pytest.mark.parametrize("name", sorted(UPSTREAM))
def test_sliders_begin_and_end_where_upstream_s_do(name):
    found = offered(name)
    for parameter, (_kind, _default, *ends) in UPSTREAM[name].items():
        for which, end, ours in zip(("low", "high"), ends, found[parameter][2:]):
            if end is not None:
                assert ours == pytest.approx(differing(name, parameter).get(which, end)), (parameter, which)


def test_the_readme_tells_what_differs_and_why():
    shown = README.read_text(encoding="utf-8")
    assert f"{SECTION[0]}\n{table()}\n{SECTION[1]}" in shown, "write it by `python3 -m upstream_parameters`"
    named = {(name, parameter) for name, parameters in DIFFERENT.items() for parameter in parameters}
    assert named <= {(name, parameter) for name in UPSTREAM for parameter in UPSTREAM[name]}


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.cfg")), ids=lambda path: path.stem)
def test_a_slider_of_ours_is_of_a_length_a_hand_can_use(path):
    for parameter, (kind, default, low, high) in offered(path.stem).items():
        if kind == "double" and low is not None and high is not None:
            assert high - low <= 2000.0 * max(1.0, abs(default)), parameter


def test_a_slider_pulled_to_its_end_leaves_no_robot_to_drive_unseen_for_seconds():
    """The control loop's ended at 0.1 Hz, and a 0 became that; Move Base Flex goes on at the rate it had."""
    _kind, _default, low, _high = offered("MoveBaseFlex")["controller_frequency"]
    with pytest.raises(ValueError, match="controller_frequency"):
        NavigatorParameters().reconfigured({"controller_frequency": low})


def served(monkeypatch, parameters, low, high):
    """Return how to change laser_max_beams as a client does, past a server that offers low to high; and what came."""
    from mbf_relay.ros.common import reconfigure

    kept, taken = {}, []

    class Server:
        def __init__(self, _config_type, take, namespace):
            kept["take"] = take
            take({"laser_max_beams": 30, "laser_z_hit": 0.9}, 0)

    monkeypatch.setitem(sys.modules, "rospy", SimpleNamespace(
        logerr=lambda *words: taken.append(words), logwarn=lambda *words: taken.append(words)))
    monkeypatch.setitem(sys.modules, "dynamic_reconfigure", types.ModuleType("dynamic_reconfigure"))
    monkeypatch.setitem(sys.modules, "dynamic_reconfigure.server", SimpleNamespace(Server=Server))
    config_type = SimpleNamespace(
        min={"laser_max_beams": low, "laser_z_hit": 0.0, **dict.fromkeys(SPEEDS, -10.0)},
        max={"laser_max_beams": high, "laser_z_hit": 1.0, **dict.fromkeys(SPEEDS, 10.0)})
    reconfigure.serve(config_type, parameters, taken.append)
    return kept["take"], taken


def test_a_value_of_a_file_beyond_its_slider_outlives_the_change_of_another(monkeypatch):
    take, taken = served(monkeypatch, AmclParameters(laser_max_beams=360, laser_z_hit=0.9), 2, 250)
    shown = take({"laser_max_beams": 250, "laser_z_hit": 0.5}, 0)  # as dynamic_reconfigure's server hands it over
    assert [(each.laser_max_beams, each.laser_z_hit) for each in taken] == [(360, 0.5)]
    assert shown["laser_max_beams"] == 360
    take({"laser_max_beams": 100, "laser_z_hit": 0.5}, 0)
    assert taken[-1].laser_max_beams == 100


def test_a_robot_that_is_asked_to_drive_slower_than_its_slowest_does(monkeypatch):
    """It was refused, in a line of the log, and the robot drove on at full speed."""
    burger = DwaParameters(max_vel_x=0.22, max_vel_trans=0.22, min_vel_trans=0.11)
    take, taken = served(monkeypatch, burger, 0, 1)
    now = {name: getattr(burger, name) for name in SPEEDS}
    shown = take({**now, "max_vel_x": 0.05, "max_vel_trans": 0.05}, 0)
    assert [(each.max_vel_x, each.max_vel_trans, each.min_vel_trans) for each in taken[:-1]] == [(0.05, 0.05, 0.05)]
    assert "min_vel_trans is 0.11" in taken[-1][1] and shown["min_vel_trans"] == 0.05
    shown = take({**shown, "min_vel_trans": 0.5}, 0)  # but nothing faster is guessed
    assert "min_vel_trans is 0.5; it must be at most" in str(taken[-1][1]) and shown["min_vel_trans"] == 0.05


@pytest.fixture
def master(monkeypatch):
    """A master that keeps parameters, and counts who asks it."""
    class Handler(xmlrpc.server.SimpleXMLRPCRequestHandler):
        def do_POST(self):
            kept.asked += 1
            super().do_POST()

    server = xmlrpc.server.SimpleXMLRPCServer(("localhost", 0), Handler, logRequests=False)
    kept = SimpleNamespace(asked=0, parameters={}, refused=())

    def set_parameter(_caller, name, value):
        kept.parameters[name] = value
        return (-1, "not this one", 0) if name in kept.refused else (1, "", 0)

    server.register_multicall_functions()
    server.register_function(set_parameter, "setParam")
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://localhost:{server.server_address[1]}")
    yield kept
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_start_does_not_keep_the_master_busy_with_each_slider(master):
    from mbf_relay.ros.common import reconfigure

    values = {f"/node/parameter_{n}": value for n, value in enumerate([True, 1, -0.5, "text"] * 10)}
    reconfigure._tell_master(values)
    assert master.parameters == values and master.asked == 1


def test_a_master_that_refuses_a_parameter_is_told_of(master):
    from mbf_relay.ros.common import reconfigure

    master.refused = ("/node/b",)
    with pytest.raises(rospy.ROSException, match="not this one"):
        reconfigure._tell_master({"/node/a": 1, "/node/b": 2})
