"""Launch files explain their arguments and hold what they name."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from roslaunch import rlutil
from roslaunch.config import load_config_default

LAUNCH = sorted((Path(__file__).resolve().parents[3] / "launch").glob("*.launch"))
TAKING_RESPAWN = [path for path in LAUNCH if '<arg name="respawn"' in path.read_text()]


@pytest.mark.parametrize("path", LAUNCH, ids=lambda path: path.name)
def test_every_argument_is_explained(path):
    for argument in ElementTree.parse(str(path)).getroot().iter("arg"):
        if "default" in argument.attrib or "value" not in argument.attrib:
            assert argument.get("doc"), f"argument {argument.get('name')} of {path.name} has no doc"


@pytest.mark.parametrize("path", LAUNCH, ids=lambda path: path.name)
def test_roslaunch_check_finds_nothing(path):
    assert rlutil.check_roslaunch(str(path)) is None  # what roslaunch-check calls; it returns the error's text


@pytest.mark.parametrize("driver", ("move_base_flex", "web_view"))
def test_nobody_drives_the_demo_s_robot_past_its_guard_into_a_box(driver):
    path, = (str(path) for path in LAUNCH if path.name == "demo.launch")
    config = load_config_default([(path, ["web:=true"])], 11311, assign_machines=False)
    node, = (node for node in config.nodes if node.name == driver)
    assert ("cmd_vel", "cmd_vel_raw") in {tuple(pair) for pair in node.remap_args}


@pytest.mark.parametrize("name", ("demo", "simulator", "turtlebot3_world", "two_burgers"))
def test_a_world_in_a_namespace_makes_the_time_of_all_nodes(name, tmp_path):
    """The parameter was set in the namespace, where no node looks: all went by the wall clock, and no goal was reached.
    """
    path, = (str(path) for path in LAUNCH if path.name == f"{name}.launch")
    outer = tmp_path / "outer.launch"
    outer.write_text(f'<launch><include file="{path}" ns="robot"/></launch>')
    config = load_config_default([str(outer)], 11311, assign_machines=False)
    assert config.params["/use_sim_time"].value is True


@pytest.mark.parametrize("path", TAKING_RESPAWN, ids=lambda path: path.name)
def test_who_looks_for_why_a_node_ends_has_none_start_again(path):
    """web_view did all the same."""
    arguments = [f"{name}:=true" for name in ("web", "record", "guard") if f'<arg name="{name}"' in path.read_text()]
    config = load_config_default([(str(path), ["respawn:=false", *arguments])], 11311, assign_machines=False)
    assert [node.name for node in config.nodes if node.respawn] == []


@pytest.mark.parametrize("name", ("simulator", "two_burgers"))
def test_a_robot_s_file_may_lie_in_a_folder_with_a_blank_in_its_name(name, tmp_path):
    """roslaunch ended: the description's command took the half of the path after the blank for an option."""
    path, = (str(path) for path in LAUNCH if path.name == f"{name}.launch")
    robot = tmp_path / "my robots" / "mine.yaml"
    robot.parent.mkdir()
    robot.write_text((LAUNCH[0].parents[1] / "config" / "robot" / "burger.yaml").read_text())
    config = load_config_default([(path, [f"robot:={robot}"])], 11311, assign_machines=False)
    assert '<robot name="mine">' in config.params["/robot_description"].value


@pytest.mark.parametrize("model", ("waffle_pi", "{folder}/waffle_pi.yaml"))
def test_a_waffle_pi_is_the_one_that_is_asked_for(model, tmp_path):
    """A file of one's own by that name was not found: it was looked for as waffle.yaml."""
    path, = (str(path) for path in LAUNCH if path.name == "turtlebot3_world.launch")
    mine = tmp_path / "waffle_pi.yaml"
    mine.write_text((LAUNCH[0].parents[1] / "config" / "robot" / "waffle.yaml").read_text())
    config = load_config_default([(path, [f"model:={model.format(folder=tmp_path)}"])], 11311, assign_machines=False)
    assert config.params["/simulator/robot"].value == (str(mine) if "/" in model else "waffle")
