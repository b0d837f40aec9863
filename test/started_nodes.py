"""Starts nodes again and again, each with a parameter changed: as children of one process that has imported all.

    started_nodes.py WORK RESULTS

WORK is a JSON list of [node, parameters, arguments]; RESULTS gets a JSON line for each: whether it came up, how it
ended, and what it said. ROS_MASTER_URI names the master.
"""

import faulthandler
import importlib
import json
import os
import pkgutil
import re
import select
import signal
import sys
import time

import mbf_relay
from mbf_relay.ros.compose.node import MEMBERS, Member, live, preload

PLACES = {
    "fake_localization": "mbf_relay.ros.fake_localization.node.main",
    "simulator": "mbf_relay.ros.simulator.node.main", "velocity_guard": "mbf_relay.ros.velocity_guard.node.main",
    "waypoint_follower": "mbf_relay.ros.waypoint_follower.node.main", "web_view": "mbf_relay.ros.web.node.main",
    "move_base": "mbf_relay.ros.move_base.node.main",
}
NAMED = ("cfg", "control", "costmap", "navigation", "planning", "recovery", "tracking")
"""Rooms of which a node imports what its parameters name."""
UP = re.compile(
    "serving a map|localizing on a map|move_base_flex is ready|move_base is here|move_base waits|simulating world|"
    "see the robot at|waypoint_follower is ready|velocity_guard is ready|fake_localization is ready")
"""What nodes say when they have read their parameters and offer what they have."""
PATIENCE = 30.0
"""Wall seconds a node gets to come up or to end, and to end after a signal, on a machine that is busy."""


def start(line):
    """Fork a node; return its process and the end of a pipe with what it says."""
    out, into = os.pipe()
    child = os.fork()
    if child:
        os.close(into)
        return child, out
    os.dup2(into, 1)
    os.dup2(into, 2)
    os.close(out)
    faulthandler.register(signal.SIGUSR1)  # one that hangs says where, each of its threads
    try:
        live(line)
    finally:
        os._exit(1)


def attend(child, out, up):
    """Follow a node until it says it is up, or ends; then ask it to end. Return (came up, exit status, what it said).

    The status is None of one that did neither in time, or does not end when it is asked to.
    """
    said, came_up, asked_at, begun = b"", False, None, time.monotonic()
    while True:
        ready, _, _ = select.select([out], [], [], 0.2)
        piece = os.read(out, 1 << 16) if ready else b""
        said += piece
        if ready and not piece:
            break
        if not came_up and up.search(said.decode(errors="replace")):
            came_up, asked_at = True, time.monotonic()
            os.kill(child, signal.SIGTERM)
        if time.monotonic() - (asked_at or begun) > PATIENCE:
            os.kill(child, signal.SIGUSR1)
            while select.select([out], [], [], 1.0)[0]:
                piece = os.read(out, 1 << 16)
                if not piece:
                    break
                said += piece
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(out)
            return came_up, None, said.decode(errors="replace")
    os.close(out)
    _, status = os.waitpid(child, 0)
    ended = os.WEXITSTATUS(status) if os.WIFEXITED(status) else -os.WTERMSIG(status)
    return came_up, ended, said.decode(errors="replace")


def main(work, results):
    """Make every start that is asked for."""
    import rosgraph

    MEMBERS.update({name: Member(name, place, {}) for name, place in PLACES.items()})
    with open(work, encoding="utf-8") as stream:
        cases = json.load(stream)
    preload(sorted({node for node, _, _ in cases}))
    for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay."):
        if module.name.split(".")[1] in NAMED:
            importlib.import_module(module.name)
    master = rosgraph.Master("/started_nodes")
    with open(results, "w", encoding="utf-8") as stream:
        for node, parameters, arguments in cases:
            name = "/" + MEMBERS[node].name
            master.setParam(name, parameters)
            came_up, status, said = attend(*start([node, *arguments]), UP)
            master.deleteParam(name)
            stream.write(json.dumps([came_up, status, said]) + "\n")
            stream.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
