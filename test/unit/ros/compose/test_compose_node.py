"""The command line of a family of nodes, and that its nodes are the executables'."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from mbf_relay.ros.common import node
from mbf_relay.ros.compose.node import MEMBERS, read_arguments

SCRIPTS = Path(__file__).resolve().parents[4] / "scripts"


def test_each_node_has_its_own_words_and_those_for_all():
    text = "-- map_server map.yaml -- amcl scan:=laser -- move_base_relay -- tf:=/tf2 __name:=navigation __log:=x.log"
    assert read_arguments(text.split()) == (True, [
        ["map_server", "map.yaml", "tf:=/tf2"], ["amcl", "scan:=laser", "tf:=/tf2"], ["move_base_relay", "tf:=/tf2"],
    ])


def test_nodes_may_stay_ended():
    assert read_arguments(["--no-respawn", "--", "amcl"]) == (False, [["amcl"]])


@pytest.mark.parametrize("text, words", [
    ("", "no node is named"),
    ("--", "no node is named"),
    ("-- amcl -- simulator", "'simulator' cannot be a member; there are map_server, amcl"),
    ("-- amcl -- -- map_server", "'' cannot be a member"),
    ("-- amcl -- amcl", "amcl is named twice"),
    ("--respawn -- amcl", "--respawn is no option"),
    ("amcl", "amcl is no option"),
])
def test_what_is_wrong_is_said(text, words):
    with pytest.raises(ValueError, match=words):
        read_arguments(text.split())


@pytest.mark.parametrize("executable", MEMBERS)
def test_a_member_is_what_its_executable_is(executable):
    tree = ast.parse((SCRIPTS / executable).read_text(encoding="utf-8"))
    call, = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    name, place = (ast.literal_eval(argument) for argument in call.args)
    arguments = {keyword.arg: ast.literal_eval(keyword.value) for keyword in call.keywords}
    assert MEMBERS[executable] == (name, place, arguments)


def modules_after(code):
    """Return the modules that there are after some lines of Python."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], stdout=subprocess.PIPE, text=True,
        check=True)
    return set(done.stdout.split())


def test_what_every_node_imports_lies_in_memory_once():
    tree = ast.parse(Path(node.__file__).read_text(encoding="utf-8"))
    imported = {found.module for found in ast.walk(tree) if isinstance(found, ast.ImportFrom)} - {"__future__"}
    prepared = modules_after("from mbf_relay.ros.compose.node import preload; preload(['amcl'])")
    assert sorted(imported - prepared) == []


def test_what_the_servers_parameters_name_lies_in_no_other_nodes_memory():
    """All plugins that there are lay in each node's, 3 MiB in the robot's, of which the server alone used a half."""
    prepared = modules_after(
        "from mbf_relay.ros.compose.node import preload\n"
        "preload(['map_server', 'amcl', 'move_base_flex', 'move_base_relay'])")
    assert "mbf_relay.ros.server.node" in prepared
    plugins = ("mbf_relay.control.critics.", "mbf_relay.control.mppi.", "mbf_relay.planning.navfn")
    assert not [name for name in prepared if name.startswith(plugins)]


def test_who_watches_the_nodes_holds_no_library_that_it_does_not_use():
    idle = modules_after("import mbf_relay.ros.compose.node") - modules_after("")
    assert "select" in idle
    assert not {"linecache", "textwrap", "traceback"} & idle
