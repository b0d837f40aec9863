"""The demo: drives the tutorial's circle in the simulated arena through the relay, and writes a report.

Exits 0 only if every goal was reached without a contact, 130 when interrupted.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import math
import os
import platform
import re
import socket
import subprocess
import sys
import time
import webbrowser
from typing import Any, Dict, List, Optional, Sequence

from defusedxml import ElementTree

from mbf_relay.commands import positive
from mbf_relay.report.drive import Drive
from mbf_relay.report.terminal import Terminal
from mbf_relay.ros.common.node import import_rospy
from mbf_relay.ros.tools.demo_graph import DemoGraph, GraphError, end_on_request, free_port, last_errors
from mbf_relay.simulation.parameters import SimulationParameters

GOALS_PER_LAP = 8
START_PATIENCE = 60.0
PROGRESS_PERIOD = 0.2
LARGEST_SEED = 2 ** 31 - 1
"""Largest integer on the parameter server."""
NODES = ("simulator", "map_server", "amcl", "move_base_flex", "move_base")


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return the exit status."""
    options = parse(arguments)
    end_on_request()
    try:
        drive = run(options)
    except KeyboardInterrupt:
        print("\ninterrupted; everything the demo started has ended", file=sys.stderr)
        return 130
    except (GraphError, OSError) as error:
        print(f"\n{error}", file=sys.stderr)
        return 1
    return 0 if drive.summary()["success"] else 1


def parse(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    """Return the options; exit with an error where they are invalid."""
    parser = argparse.ArgumentParser(prog="demo", description="Drive the tutorial's circle in the simulated arena.")
    parser.add_argument("--laps", type=positive, default=1, metavar="N", help="rounds to drive (default: %(default)s)")
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="F", help="simulated seconds per second of wall time (default: 1)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of all random numbers (default: %(default)s)")
    parser.add_argument(
        "--rviz", dest="rviz", action="store_true", default=None, help="open RViz (default: if there is a display)"
    )
    parser.add_argument("--no-rviz", dest="rviz", action="store_false", help="do not open RViz")
    parser.add_argument("--web", action="store_true", help="show it in a browser instead of RViz, and take goals there")
    parser.add_argument(
        "--relay", choices=("server", "subscriber", "both"), default="both",
        help="how the relay takes goals: by the action, the topic or both (default: %(default)s)",
    )
    parser.add_argument(
        "--report", default="demo_report", metavar="DIR",
        help="folder for report.json, report.png, report.html and the logs (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    if not (math.isfinite(options.speed) and options.speed > 0.0):
        parser.error(f"--speed is {options.speed}; it must be above 0")
    if not 0 <= options.seed <= LARGEST_SEED:
        parser.error(f"--seed is {options.seed}; it must be 0 to {LARGEST_SEED}")
    if options.rviz and not has_display():
        parser.error("--rviz needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set")
    if options.rviz is None:
        options.rviz = has_display() and not options.web
    return options


def run(options: argparse.Namespace) -> Drive:
    """Start the graph, drive, write the report, and end the graph.

    Raises:
        GraphError: The nodes did not start, ended too soon, or the report cannot be written.
        KeyboardInterrupt: Ctrl-C, or a request to terminate.
    """
    folder = os.path.abspath(options.report)
    logs = os.path.join(folder, "log")
    if os.path.exists(logs) and not os.path.isdir(logs):
        raise GraphError(f"{logs} is a file, and the logs go into a folder of that name; give another --report")
    try:
        os.makedirs(logs, exist_ok=True)
    except OSError as error:
        raise GraphError(f"--report: {folder} cannot be written: {error.strerror}; give another") from error
    print(
        f"starting simulator, localization, navigation and relay (seed {options.seed}, {options.speed:g} x real time)",
        flush=True,
    )
    launch = [
        "mbf_relay", "demo.launch", f"relay:={options.relay}", f"real_time_factor:={options.speed}",
        f"seed:={options.seed}", f"rviz:={str(options.rviz).lower()}", f"web:={str(options.web).lower()}",
    ]
    if options.web:
        port = free_port()
        launch.append(f"web_port:={port}")
    with DemoGraph(launch, logs) as graph:
        graph.wait_for_parameter("/use_sim_time", START_PATIENCE)
        if options.web:
            show_in_browser(graph, port, START_PATIENCE)
        drive = watch(graph, options, logs)
        print("writing the report", flush=True)
        from mbf_relay.ros.tools.drive_report import write_report

        try:
            paths = write_report(drive, folder)
        except OSError as error:
            raise GraphError(f"the report cannot be written: {error}") from error
    for path in paths:
        print(path)
    return drive


def show_in_browser(graph: DemoGraph, port: int, timeout: float) -> None:
    """Print the page's address and, where there is a display, open it.

    Args:
        graph: The demo's processes.
        port: TCP port of web_view.
        timeout: Wall time (s) to wait for it.

    Raises:
        GraphError: It does not listen by then, or a node ended.
    """
    deadline = time.monotonic() + timeout
    while True:
        graph.check()
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            break
        except OSError as error:
            if time.monotonic() > deadline:
                raise GraphError(f"web_view did not come up within {timeout:.0f} s") from error
            time.sleep(PROGRESS_PERIOD)
    address = f"http://127.0.0.1:{port}/"
    print(f"see it at {address}", flush=True)
    if has_display():
        webbrowser.open(address)


def has_display() -> bool:
    """Return whether there is an X or Wayland display."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def watch(graph: DemoGraph, options: argparse.Namespace, logs: str) -> Drive:
    """Start the client, show its progress until it ends, and return the drive."""
    os.environ.update(graph.environment)
    import_rospy()
    import rospy

    from mbf_relay.ros.tools.drive_recorder import DriveRecorder

    rospy.init_node("demo", disable_signals=True)
    planners = rospy.get_param("/move_base_flex/planners", [])
    recorder = DriveRecorder([f"move_base_flex/{planner['name']}/plan" for planner in planners])
    terminal = Terminal(sys.stdout, GOALS_PER_LAP * options.laps, os.environ)
    log = os.path.join(logs, "client.log")
    wait_for_server(graph, START_PATIENCE)
    client = graph.start([program_beside("mb_relay_client.py"), "--laps", str(options.laps)], log)
    started = time.monotonic()
    ended = 0
    while client.poll() is None:
        graph.check()
        ended = show(recorder, terminal, ended, rospy.get_time())
        time.sleep(PROGRESS_PERIOD)
    wall_time = time.monotonic() - started
    settle(recorder, client, wall_time)
    show(recorder, terminal, ended, rospy.get_time())
    say_last_word(terminal, client, log, os.path.join(logs, "roslaunch.log"))
    drive = recorder.drive()
    drive.wall_time, drive.seed, drive.goals_asked = wall_time, options.seed, GOALS_PER_LAP * options.laps
    drive.parameters = {node: rospy.get_param(f"/{node}", {}) for node in NODES}
    robot = SimulationParameters.from_mapping(drive.parameters["simulator"])
    drive.speed_limits = robot.max_speed, robot.max_turn_rate
    drive.versions = versions()
    terminal.table(drive)
    recorder.close()
    rospy.signal_shutdown("the drive is over")
    return drive


def program_beside(name: str) -> str:
    """Return the path of another executable of this package, in this one's folder; rosrun would search for 0.5 s."""
    return os.path.join(os.path.dirname(os.path.abspath(sys.argv[0])), name)


def wait_for_server(graph: DemoGraph, timeout: float) -> None:
    """Wait for the server's action, so that the first goal's time does not include the start of the nodes.

    Raises:
        GraphError: It takes more than `timeout` (s, wall time), or a node ended.
    """
    from mbf_msgs.msg import MoveBaseAction

    from mbf_relay.ros.common.actions.action_client import ActionClient

    server = ActionClient("move_base_flex/move_base", MoveBaseAction)
    deadline = time.monotonic() + timeout
    try:
        while not server.wait_for_server(PROGRESS_PERIOD):
            graph.check()
            if time.monotonic() > deadline:
                raise GraphError(f"{server.name} did not come up within {timeout:.0f} s")
    finally:
        server.close()


def show(recorder: Any, terminal: Terminal, ended: int, now: float) -> int:
    """Print the goals that ended after the first `ended`, and the active one's progress; return how many ended."""
    goals = recorder.goals()
    if len(goals) < ended:  # the record started again, as the clock was set back
        ended = 0
    for number, goal in enumerate(goals[ended:], ended + 1):
        if goal.ended is None:
            terminal.progress(number, recorder.distance_left, recorder.speed, now - goal.started, len(goal.recoveries))
            break
        terminal.ended(number, goal)
        ended = number
    return ended


def settle(recorder: Any, client: subprocess.Popen, patience: float) -> None:
    """Wait until the recorder, like the client, has the last goal's result; at most 2 s and `patience` (s)."""
    deadline = time.monotonic() + min(2.0, patience)
    while client.returncode == 0 and time.monotonic() < deadline:
        goals = recorder.goals()
        if goals and goals[-1].ended is not None:
            return
        time.sleep(0.02)


def say_last_word(terminal: Terminal, client: subprocess.Popen, log: str, nodes_log: str) -> None:
    """Print the client's result and, where it failed, its errors and the relay's reasons."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        verdicts = [line.strip() for line in stream if line.startswith("Drove circle")]
    for line in verdicts:
        terminal.line(line)
    if client.returncode != 0:
        terminal.line(f"the client ended with status {client.returncode}:\n{last_errors(log)}")
        for reason in reasons_of_aborts(nodes_log):
            terminal.line(f"the reason: {reason}")


def reasons_of_aborts(log: str) -> List[str]:
    """Return the relay's reasons for aborted goals from a log of the nodes; move_base's status texts lack them."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        return re.findall(r"\bgoal \S+ aborted: ([^\x1b\n]+)", stream.read())


def versions() -> Dict[str, str]:
    """Return the versions of Python, ROS and the packages in use, by name."""
    import rospkg

    found = {"python": platform.python_version(), "ROS": os.environ.get("ROS_DISTRO", "unknown")}
    for name in ("numpy", "numba", "scipy", "matplotlib"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # numba is only needed where kernels are compiled
            found[name] = "not installed"
    packages = rospkg.RosPack()
    for name in ("mbf_relay", "mbf_msgs", "rospy", "actionlib"):
        try:
            manifest = os.path.join(packages.get_path(name), "package.xml")
            found[name] = ElementTree.parse(manifest).findtext("version", "unknown").strip()
        except (rospkg.ResourceNotFound, OSError, ElementTree.ParseError):
            found[name] = "unknown"
    return found

