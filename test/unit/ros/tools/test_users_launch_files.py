"""Users' launch files load with nothing but another `pkg`: every name finds what it names, and no value is refused."""

import sys
from pathlib import Path

import pytest

TEST = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(TEST))

import users_launch_files
from roslaunch.config import load_config_default

from mbf_relay.navigation.examination import DOUBTFUL, IGNORED, REFUSED
from mbf_relay.ros.tools.check_config import examine
from mbf_relay.ros.tools.parameter_source import LaunchedNode, ParameterSource, read_launch

ROOT = TEST.parent
MAP = str(ROOT / "config" / "maps" / "turtlebot3_world.yaml")
IGNORED_UPSTREAM = {"conservative_reset_dist", "footprint_padding", "map_type", "vth_samples"}
"""Names that C++'s does not read either where they stand: move_base's at Move Base Flex, a costmap's at move_base."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return users_launch_files.swapped_into(tmp_path_factory.mktemp("launch_files"))


def loaded(folder, name):
    """Return what roslaunch makes of a file."""
    given = [f"{key}:={value}" for key, value in users_launch_files.arguments_of(name, MAP).items()]
    return load_config_default([(str(folder / f"{name}.launch"), given)], 11311, verbose=False)


def server_values(folder, name):
    """Return what roslaunch puts under the node that plans and drives, nested."""
    server = users_launch_files.SERVERS.get(name, "/move_base")
    source = ParameterSource()
    for full, parameter in loaded(folder, name).params.items():
        if full.startswith(f"{server}/"):
            source.put(full[len(server):], parameter.value, "")
    return source.values


def test_there_are_twelve_and_each_is_written_for_others():
    assert len(users_launch_files.NAMES) == 12
    for path in users_launch_files.FOLDER.glob("*.*"):
        assert "mbf_relay" not in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", users_launch_files.NAMES)
def test_every_node_has_an_executable(folder, name):
    config = loaded(folder, name)
    assert config.config_errors == [], "what roslaunch makes nothing of, nobody's robot has"
    nodes = config.nodes
    assert len(nodes) >= (1 if name == "mapless" else 3)
    for node in nodes:
        if node.package == "mbf_relay":
            assert (ROOT / "scripts" / node.type).is_file(), node.type


@pytest.mark.parametrize("name", users_launch_files.NAMES)
def test_no_value_is_refused_or_doubtful_or_lost(folder, name):
    kind = "move_base_flex" if name == "flex" else "move_base"
    source = ParameterSource(server_values(folder, name))
    found = examine(LaunchedNode(name, kind, source))
    assert found.of(REFUSED) == [] and found.of(DOUBTFUL) == []
    assert {finding.name.rpartition("/")[2] for finding in found.of(IGNORED)} <= IGNORED_UPSTREAM
    assert found.config["controllers"] and found.config["planners"]


@pytest.mark.parametrize("name", users_launch_files.NAMES)
def test_check_config_reads_what_roslaunch_loads(folder, name):
    path = str(folder / f"{name}.launch")
    servers = {node.name: node for node in read_launch(path, users_launch_files.arguments_of(name, MAP)).nodes}
    server = users_launch_files.SERVERS.get(name, "/move_base").strip("/")
    assert servers[server].source.values == server_values(folder, name)
