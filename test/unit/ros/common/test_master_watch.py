"""A node whose master is replaced says so, gives back the parameters it knew, and ends, to be started again."""

import os
import subprocess
import xmlrpc.client
from pathlib import Path
from types import SimpleNamespace

import pytest
from programs import program
from ros_master import Master
from ros_testing import wait_until

from mbf_relay.ros.common import master_watch
from mbf_relay.ros.tools.demo_graph import free_port

MAP = Path(__file__).resolve().parents[4] / "config" / "maps" / "turtlebot3_world.yaml"


def start(port, folder, *arguments):
    environment = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}", ROS_LOG_DIR=str(folder))
    return subprocess.Popen(
        [program("map_server"), str(MAP), *arguments], env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, universal_newlines=True,
    )


def test_a_node_ends_for_a_new_master_and_leaves_it_its_parameters_and_those_of_one_that_died(tmp_path):
    """A relay or guard that died after its master came back with defaults, another robot's limits among them."""
    port = free_port()
    master = Master(port)
    master.answer("setParam", "/floor/dead", {"frame_id": "first_floor"})
    node = start(port, tmp_path, "_frame_id:=house")
    dead = None
    try:
        wait_until(lambda: master.answer("lookupService", "/static_map"), "the node to come up")
        master.kill()
        master = Master(port)
        dead = start(port, tmp_path, "__name:=dead", "__ns:=/floor", "__log:=/log/of a run/dead.log")
        assert "serving a map" in dead.stdout.readline()
        assert master.answer("getParam", "/floor/dead/frame_id") == "first_floor"
        output = node.communicate(timeout=60.0)[0]
        assert node.returncode == 1
        assert "is another one and does not know /map_server" in output and "Traceback" not in output
        assert master.answer("getParam", "/map_server/frame_id") == "house"
    finally:
        for process in filter(None, (node, dead)):
            process.kill()
            process.communicate()
        master.kill()


def test_who_starts_the_world_last_has_the_other_nodes_start_again_in_its_time(tmp_path):
    """They went by the computer's clock for good: each scan and transform of the world was 56 years old to them."""
    port = free_port()
    master = Master(port)
    node = start(port, tmp_path)
    try:
        wait_until(lambda: master.answer("lookupService", "/static_map"), "the node to come up")
        master.answer("registerPublisher", "/clock", "rosgraph_msgs/Clock", "http://localhost:1/")
        master.answer("setParam", "/use_sim_time", True)
        output = node.communicate(timeout=60.0)[0]
        assert node.returncode == 1
        assert "use_sim_time" in output and "/clock of /test" in output and "Traceback" not in output
    finally:
        node.kill()
        node.communicate()
        master.kill()


@pytest.mark.parametrize("is_set, publishers", [(False, ["/simulator"]), (True, []), (True, ["/amcl"])])
def test_a_robot_s_nodes_live_on_where_no_world_was_started(monkeypatch, is_set, publishers):
    """A parameter that was left or set by mistake must not end them, nor what makes the time itself."""
    state = [[["/clock", publishers]], [], []]
    master = SimpleNamespace(
        getParam=lambda _name, key: (1, "", {} if key == "/" else is_set), getPid=lambda _name: (1, "", 7),
        getSystemState=lambda _name: (1, "", state))
    monkeypatch.setattr(master_watch.xmlrpc.client, "ServerProxy", lambda _uri: master)
    monkeypatch.setattr(master_watch, "impatient_proxy", lambda *_: master)
    monkeypatch.setattr(master_watch, "rospy", SimpleNamespace(get_name=lambda: "/amcl", on_shutdown=lambda end: None))
    monkeypatch.setattr(master_watch.MasterWatch, "_loop", lambda self: None)
    assert master_watch.MasterWatch(lambda reason: None).other_time() == ""


def test_a_node_comes_up_while_others_set_their_parameters(monkeypatch):
    """rosmaster's answer is a fault where its tree grows meanwhile, and the node ended in a traceback."""
    faults = iter([xmlrpc.client.Fault(1, "RuntimeError: dictionary changed size during iteration")] * 3)

    def get_param(_name, _key):
        for fault in faults:
            raise fault
        return 1, "", {"amcl": {"seed": 1}}

    master = SimpleNamespace(getParam=get_param, getPid=lambda _name: (1, "", 7))
    monkeypatch.setattr(master_watch.xmlrpc.client, "ServerProxy", lambda _uri: master)
    monkeypatch.setattr(master_watch, "rospy", SimpleNamespace(get_name=lambda: "/amcl", on_shutdown=lambda end: None))
    monkeypatch.setattr(master_watch.MasterWatch, "_loop", lambda self: None)
    assert master_watch.MasterWatch(lambda reason: None)._seen == {"amcl": {"seed": 1}}
