"""Nodes started one after the other beside a master and a map, and how each of them did."""

import json
import os
import subprocess
import sys
from pathlib import Path

from programs import program
from ros_master import Master

from mbf_relay.ros.tools.demo_graph import free_port

ROOT = Path(__file__).resolve().parents[1]
MAP = str(ROOT / "config" / "maps" / "turtlebot3_world.yaml")


def how_they_start(work, folder):
    """Start nodes; return for each whether it came up, its exit status (None where it hangs), and what it said.

    Args:
        work: A list of (node, its parameters, its arguments); see started_nodes.py.
        folder: Where files and logs go.
    """
    (folder / "work").write_text(json.dumps(work))
    master = Master(free_port())
    environment = dict(os.environ, ROS_MASTER_URI=master.uri, ROS_LOG_DIR=str(folder))
    a_map = subprocess.Popen(
        [program("map_server"), MAP, "__name:=a_map"], env=environment, stdout=subprocess.DEVNULL)
    try:
        starter = ROOT / "test" / "started_nodes.py"
        subprocess.run([sys.executable, starter, folder / "work", folder / "results"], env=environment, check=True)
    finally:
        a_map.terminate()
        a_map.wait()
        master.kill()
    results = [json.loads(line) for line in (folder / "results").read_text().splitlines()]
    assert len(results) == len(work)
    return results
