"""A signal ends every node: at any moment, with status 0, without a traceback, whatever the master does."""

import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from programs import program
from ros_testing import wait_until
from tally import LONG, trial

from mbf_relay.ros.tools.demo_graph import free_port

ROOT = Path(__file__).resolve().parents[4]
NODES = {
    "amcl": [], "fake_localization": [], "map_server": [str(ROOT / "config" / "maps" / "turtlebot3_world.yaml")],
    "mb_relay_server.py": [],
    "mb_relay_subscriber.py": [], "move_base_flex": [], "move_base_relay": [], "simulator": [], "velocity_guard": [],
    "map_saver": [], "waypoint_follower": [], "web_view": ["_port:=0"],
}
CLIENTS = {"mb_relay_client.py": [], "mbf_path_client.py": [], "mbf_goal_client.py": [], "movebase_client.py": []}
TRIED = list(NODES) + list(CLIENTS)[:4 if LONG else 2]
CASES = [(index, name) for index, name in enumerate(TRIED * (20 if LONG else 1))]
STARTED = 4.0
"""Wall seconds after which a node has long come up, on a machine that is not busy."""


@pytest.fixture(scope="module")
def masters():
    """Ports of a master that works, one that hangs, and one that is not there."""
    working, absent = free_port(), free_port()
    process = subprocess.Popen(
        [sys.executable, "-c", "import rosmaster; rosmaster.rosmaster_main()", "--core", "-p", str(working)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )
    hanging = socket.socket()
    hanging.bind(("localhost", 0))
    hanging.listen(100)
    try:
        yield {"working": working, "hanging": hanging.getsockname()[1], "absent": absent}
    finally:
        hanging.close()
        process.kill()
        process.wait()


def start(name, arguments, port, folder):
    environment = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}", ROS_LOG_DIR=str(folder))
    with open(str(folder / "output"), "wb") as log:
        return subprocess.Popen(
            [program(name), *arguments], env=environment, stdout=log, stderr=subprocess.STDOUT
        )


def is_ready_to_end(process):
    """Return whether a process has blocked SIGTERM, which is the first thing a node does."""
    assert process.poll() is None, "it ended by itself"
    if "python" not in os.path.basename(os.readlink(f"/proc/{process.pid}/exe")):
        return False  # env, which looks for the interpreter
    with open(f"/proc/{process.pid}/status", encoding="ascii") as stream:
        blocked = next(line for line in stream if line.startswith("SigBlk"))
    return int(blocked.split()[1], 16) >> (signal.SIGTERM - 1) & 1


@pytest.mark.parametrize("index, name", CASES)
def test_a_signal_ends_a_node_at_any_moment(index, name, masters, tmp_path):
    with trial("nodes ended by a signal while they start or run") as made:
        end_by_a_signal(index, name, masters, tmp_path, made)


def end_by_a_signal(index, name, masters, tmp_path, made):
    chance = random.Random(index)
    master = chance.choice(sorted(masters))
    process = start(name, {**NODES, **CLIENTS}[name], masters[master], tmp_path)
    try:
        wait_until(lambda: is_ready_to_end(process), f"{name} to begin")
        # no condition to wait for: the moment itself is what is tried
        time.sleep(chance.uniform(0.0, STARTED) * chance.random())
        signalled = time.monotonic()
        process.send_signal(chance.choice((signal.SIGINT, signal.SIGTERM)))
        status = process.wait(20.0)
        made.measure("ended after", time.monotonic() - signalled, "s")
    finally:
        process.kill()
        process.wait()
    output = (tmp_path / "output").read_text(errors="replace")
    # 0 of a client says that the robot arrived
    assert status == (130 if name in CLIENTS else 0), (master, output)
    assert "Traceback" not in output, (master, output)


def test_a_robot_whose_master_comes_up_last_has_all_its_nodes(masters, tmp_path):
    """A node with a parameter among its arguments ended at once, where others wait for the master."""
    process = start("map_saver", ["_x:=1"], masters["absent"], tmp_path)
    try:
        told = tmp_path / "output"
        wait_until(lambda: process.poll() is not None or "waiting for it" in told.read_text(), "word of the master")
        assert process.poll() is None, told.read_text()
        assert f"no ROS master at http://localhost:{masters['absent']} " in told.read_text()
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0, told.read_text()
    finally:
        process.kill()
        process.wait()
    assert "Traceback" not in told.read_text()


def test_a_launch_that_is_interrupted_at_once_shows_few_tracebacks():
    """What nodes import before they await signals can be interrupted; their log was a third of it."""
    code = (
        "import sys\nfrom mbf_relay.ros.common import node\n"
        "print({'logging', 'traceback', 'rospy'} & set(sys.modules))"
    )
    assert subprocess.check_output([sys.executable, "-S", "-c", code], text=True) == "set()\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_node_that_nobody_can_shut_down(number, tmp_path):
    code = (
        "import signal, threading\nsignal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup\n"
        "from mbf_relay.ros.common.ending import NodeEnding\n"
        "ending = NodeEnding()\nending.use(lambda reason: threading.Event().wait())\n"
        "print('ready', flush=True)\nthreading.Event().wait()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(number)
        assert process.wait(20.0) == 0
    finally:
        process.kill()
        process.communicate()
