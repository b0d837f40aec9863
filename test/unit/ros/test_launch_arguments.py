"""Whatever is given for an argument of a launch file: it is refused in a line, or by the nodes that get it.

The usual suite tries what the files calculate with; `--long` anything for any argument, and starts what it reaches.
"""

import random
import re
import shlex
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from node_starts import how_they_start
from roslaunch import config as roslaunch_config
from roslaunch.core import RLException
from roslaunch.loader import Loader
from tally import LONG, how_many, trial

from mbf_relay.ros.compose.node import MEMBERS

ROOT = Path(__file__).resolve().parents[3]
VALUES = (
    "true", "rubbish", "inf", "nan", "", "-1", "1e300", "/nowhere/x.yaml", "[1, 2", "{a: 1}", "a b", "é", "0",
    "/dev/null", "/tmp", "~", "../..", "2147483647",
)
STARTED = {*MEMBERS, "simulator", "velocity_guard", "waypoint_follower", "web_view"}


def launched(path, *arguments):
    """Return the nodes of a launch file by name: package, type, arguments, own parameters."""
    config = roslaunch_config.load_config_default([(str(path), list(arguments))], 11311, assign_machines=False)
    nodes = {}
    for node in config.nodes:
        name = node.namespace + node.name
        own = {}
        for key, value in sorted(config.params.items()):
            if key.startswith(f"{name}/"):
                here = own
                *groups, last = key[len(name) + 1:].split("/")
                for group in groups:
                    here = here.setdefault(group, {})
                here[last] = value.value
        nodes[name] = (node.package, node.type, shlex.split(node.args), own)
    return nodes


def arguments_of(path):
    """Return a launch file's arguments, and those of them that it calculates with."""
    text = path.read_text()
    names = [each.get("name") for each in ElementTree.fromstring(text).findall("arg") if "value" not in each.attrib]
    calculated = " ".join(re.findall(r"\$\(eval (.*?)\)\"", text))
    return names, [name for name in names if re.search(rf"\b{name}\b", calculated)]


def cases():
    for path in sorted((ROOT / "launch").glob("*.launch")):
        names, calculated = arguments_of(path)
        for name in names if LONG else calculated:
            for value in VALUES if LONG else VALUES[:3]:
                yield path, name, value


def test_an_argument_of_any_kind_is_refused_in_a_line_or_by_the_node_that_gets_it(tmp_path, monkeypatch):
    if not LONG:  # programs that make a parameter take ten times the rest
        read = Loader.param_value
        monkeypatch.setattr(Loader, "param_value", lambda *given: "" if given[-1] else read(*given))
    drawn = list(cases())
    random.Random(9).shuffle(drawn)
    found, work = [], {}
    usual = {}
    for path, name, value in drawn[:how_many(60, 600)]:
        usual[path] = usual.get(path) or launched(path)
        try:
            nodes = launched(path, f"{name}:={value}")
        except (RLException, ValueError):  # what roslaunch tells without a traceback
            continue
        except Exception as error:
            found.append(f"{path.name} {name}:={value}: {error!r}")
            continue
        for node, (package, kind, arguments, own) in nodes.items():
            if package == "mbf_relay" and kind in STARTED and (package, kind, arguments, own) != usual[path].get(node):
                apart = ["static_map:=another_map"] if kind == "map_server" else []
                work.setdefault((kind, name, value), [kind, own, arguments + apart])
    if LONG:
        found += started(work, tmp_path)
    assert not found, "\n".join(found)


def started(work, folder):
    """Start nodes with what reached them; return what is wrong with how they did."""
    found = []
    starts = how_they_start(list(work.values()), folder)
    for (kind, name, value), (came_up, status, said) in zip(work, starts):
        fatal = [line for line in said.splitlines() if "[FATAL]" in line]
        fine = status == 0 if came_up else status == 1 and len(fatal) <= 1
        try:
            with trial("launch arguments of any kind"):
                assert fine and "Traceback" not in said, f"{kind} by {name}:={value}: {status}\n{said[-800:]}"
        except AssertionError as error:
            found.append(str(error))
    return found


@pytest.mark.parametrize("name", ["12", "1e3", "true"])
@pytest.mark.parametrize("file", ["simulator.launch", "turtlebot3_world.launch", "demo.launch"])
def test_a_world_may_be_called_by_a_number(monkeypatch, file, name):
    """roslaunch made one of its name, and the simulator ended: it must be of type str."""
    read = Loader.param_value
    monkeypatch.setattr(Loader, "param_value", lambda *given: "" if given[-1] else read(*given))  # no programs
    assert launched(ROOT / "launch" / file, f"world_name:={name}")["/simulator"][3]["world_name"] == name
