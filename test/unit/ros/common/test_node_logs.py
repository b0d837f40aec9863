"""A node whose disk is full, whose home is none or whose master hangs goes on, and says so in a sentence."""

import logging
import os
import re
import resource
import subprocess
import threading
from pathlib import Path

import pytest
import rospy
import rospy.impl.paramserver
from programs import program
from ros_master import Master
from ros_testing import wait_until
from rosgraph.roslogging import RosStreamHandler

from mbf_relay.ros.common import logs
from mbf_relay.ros.tools.demo_graph import free_port

MAP = Path(__file__).resolve().parents[4] / "config" / "maps" / "turtlebot3_world.yaml"


@pytest.fixture
def master():
    master = Master(free_port())
    yield master
    master.kill()


def words_of_a_node(
    master, environment, full=False, terminal=subprocess.PIPE, command=("map_server", str(MAP)), offered="/map",
    prepare=None,
):
    """Run a node until it offers a topic, end it, and return what it said, where `terminal` is no file."""
    node = subprocess.Popen(
        [program(command[0]), *command[1:]], env=dict(environment, ROS_MASTER_URI=master.uri),
        stdout=terminal, stderr=subprocess.STDOUT, universal_newlines=True,
        preexec_fn=(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))) if full else prepare,
    )
    try:
        wait_until(lambda: offered in dict(master.answer("getPublishedTopics", "")), "the node to come up", 60.0)
        node.terminate()
        output = node.communicate(timeout=60.0)[0] or ""
    finally:
        node.kill()
        node.communicate()
    assert node.returncode == 0 and "Traceback" not in output, output
    return output


def test_a_node_whose_disk_is_full_says_so_in_one_sentence(master, tmp_path):
    output = words_of_a_node(master, dict(os.environ, ROS_LOG_DIR=str(tmp_path)), full=True)
    assert output.count("the log cannot be written") == 1 and "serving a map" in output, output


def test_a_client_whose_disk_is_full_says_so_in_one_sentence(master, tmp_path):
    client = subprocess.run(
        [program("mb_relay_client.py"), "--timeout", "0.5"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=dict(os.environ, ROS_MASTER_URI=master.uri, ROS_LOG_DIR=str(tmp_path)), text=True,
        timeout=60.0, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
    )
    output = client.stdout
    assert client.returncode == 1 and "Traceback" not in output and "Call stack" not in output, output
    assert output.count("the log cannot be written") == 1, output


def test_a_node_whose_terminal_is_a_file_on_a_full_disk_serves_all_the_same(master, tmp_path):
    with open("/dev/full", "wb") as terminal:
        words_of_a_node(master, dict(os.environ, ROS_LOG_DIR=str(tmp_path)), full=True, terminal=terminal)


@pytest.mark.parametrize("command", [
    ("map_server", str(MAP)), ("compose", "--no-respawn", "--", "map_server", str(MAP), "--")])
def test_a_node_that_was_started_without_a_terminal_serves_and_ends_as_any_other(master, tmp_path, command):
    words_of_a_node(
        master, dict(os.environ, ROS_LOG_DIR=str(tmp_path)), command=command, prepare=lambda: os.closerange(0, 3))
    (log,) = tmp_path.rglob("map_server*.log")
    assert "serving a map" in log.read_text() and "Traceback" not in log.read_text()


def terminal_at(pipe):
    """Return the handler and the logger of a terminal that is the end of a pipe."""
    return RosStreamHandler(colorize=False, stdout=pipe, stderr=pipe), logging.getLogger("rosout")


def file_at(pipe):
    """Return likewise what writes a file, on a disk that is that end."""
    return logging.FileHandler(f"/dev/fd/{pipe.fileno()}", mode="w"), logging.getLogger()


@pytest.fixture(params=[terminal_at, file_at])
def stuck_log(request, monkeypatch):
    """Make a pipe that is full, which nobody reads, all that this process's log leads to; gives its reading end."""
    reading, writing = os.pipe()
    with open(reading, "rb") as reader, open(writing, "w", buffering=1) as writer:
        os.set_blocking(writing, False)
        with pytest.raises(BlockingIOError):
            while True:
                os.write(writing, b"\n" * 4096)
        os.set_blocking(writing, True)
        handler, logger = request.param(writer)
        monkeypatch.setattr(logging.getLogger("rosout"), "handlers", [])
        monkeypatch.setattr(logging.getLogger(), "handlers", [])
        monkeypatch.setattr(logger, "handlers", [handler])
        monkeypatch.setattr(logging, "_logRecordFactory", logs.PlainRecord)
        yield reader
        handler.close()


def test_a_watchdog_is_not_held_up_by_a_terminal_or_a_disk_that_takes_no_lines(stuck_log):
    logs.log_without_waiting()
    place, said_in_all, said = [1], logs.MOST_WAITING + 10, threading.Event()

    def say():
        for number in range(1, 1 + said_in_all):
            logging.getLogger("rosout").warning("navigation hangs for the %d. time, the wheels at %s", number, place)
        place[0] = 2
        said.set()

    threading.Thread(target=say, daemon=True).start()
    in_time = said.wait(10.0)
    told = ""
    while not re.search(rf"{said_in_all}\. time.*\n", told):  # somebody reads again, to the end of the last line
        told += os.read(stuck_log.fileno(), 4096).decode()
    assert in_time, "whoever logs waits for who writes"
    left_out = int(re.search(r"(\d+) lines are left out", told).group(1))
    assert told.count("the wheels at [1]") + left_out == said_in_all


@pytest.mark.parametrize("home", ["/proc/nobody", None])
def test_a_node_without_a_home_speaks_on_the_terminal(master, home, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name not in ("ROS_LOG_DIR", "ROS_HOME", "HOME")}
    environment.update({"HOME": home} if home else {"ROS_LOG_DIR": str(tmp_path)})
    output = words_of_a_node(master, environment)
    assert "serving a map" in output, output
    assert home is None or "cannot create log directory" in output, output


@pytest.mark.parametrize("name, told", [
    ("map\n[INFO] [12.0]: Goal reached", "map\n  | [INFO] [12.0]: Goal reached"),
    ("map\r[INFO] [12.0]: Goal reached", r"map\r[INFO] [12.0]: Goal reached"),
    ("\x1b[2J\x1b]0;title\x07", r"\x1b[2J\x1b]0;title\x07"),
    ("right\u202eto left, next\u2028line, next\x85one", r"right\u202eto left, next\u2028line, next\x85one"),
    ("half a sign \ud800", r"half a sign \ud800"),
    ("a robot's \"própria\" 地图 \\n", "a robot's \"própria\" 地图 \\n"),
])
def test_a_stranger_forges_no_line_of_the_log_by_the_name_of_a_frame_or_goal(name, told):
    record = logs.PlainRecord("rosout", logging.WARNING, "node.py", 1, "goal in frame '%s'", (name,), None)
    assert logging.Formatter("%(levelname)s: %(message)s").format(record) == f"WARNING: goal in frame '{told}'"


def test_a_stranger_forges_no_line_of_a_running_nodes_log_by_the_name_of_a_parameter(master, tmp_path):
    forged = "A\n[ WARN] [1.0]: forged"
    master.answer("setParam", "/velocity_guard", {forged: 1})
    environment = dict(os.environ, ROS_LOG_DIR=str(tmp_path))
    told = words_of_a_node(master, environment, command=("velocity_guard",), offered="/velocity_guard/state")
    told += "".join(log.read_text() for log in tmp_path.rglob("velocity_guard*.log"))
    assert told.count("A\n  | [ WARN] [1.0]: forged") == 2 and forged not in told, told


def test_a_robot_whose_node_logs_a_line_does_not_wait_for_a_master_that_hangs(monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")  # where nobody is
    monkeypatch.setattr(rospy, "get_param", lambda _name, default: default)
    monkeypatch.setattr(rospy.client, "_param_server", None)
    monkeypatch.setattr(rospy.impl.paramserver, "_param_server_cache", None)
    with pytest.raises((OSError, TypeError)):
        rospy.get_param_cached(logs.TOPICS_IN_LOGS_DISABLED)  # as rospy does for each line
    logs.log_without_master()
    assert rospy.get_param_cached(logs.TOPICS_IN_LOGS_DISABLED) is False
