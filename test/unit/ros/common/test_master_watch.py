"""A node whose master is replaced says so, gives its parameters back, and ends, so that it can be started again."""

import os
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

from ros_master import Master  # noqa: E402
from ros_testing import wait_until  # noqa: E402

from mbf_relay.ros.tools.demo_graph import free_port  # noqa: E402

MAP = Path(__file__).resolve().parents[4] / "config" / "maps" / "turtlebot3_world.yaml"


def test_a_node_ends_for_a_new_master_and_leaves_it_its_parameters(tmp_path):
    port = free_port()
    environment = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}", ROS_LOG_DIR=str(tmp_path))
    master = Master(port)
    node = subprocess.Popen(
        ["rosrun", "mbf_relay", "map_server", str(MAP), "_frame_id:=house"], env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, universal_newlines=True,
    )
    try:
        wait_until(lambda: master.answer("lookupService", "/static_map"), "the node to come up")
        master.kill()
        master = Master(port)
        output = node.communicate(timeout=60.0)[0]
        assert node.returncode == 1
        assert "is another one and does not know /map_server" in output and "Traceback" not in output
        assert master.answer("getParam", "/map_server/frame_id") == "house"
    finally:
        node.kill()
        node.communicate()
        master.kill()
