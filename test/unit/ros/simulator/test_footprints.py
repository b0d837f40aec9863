"""Navigation that takes the simulated robot for a smaller one is told of."""

import pytest

from mbf_relay import files
from mbf_relay.lockstep.settings import load_settings
from mbf_relay.ros.simulator.footprints import drivers, too_small_footprints
from mbf_relay.ros.tools.robot_parameters import parameters_for
from mbf_relay.simulation.robot_file import load_robot

BURGERS = {"/move_base_flex": load_settings(files.config_folder())["move_base_flex"]}
WAFFLES = [[-0.205, -0.155], [-0.205, 0.155], [0.077, 0.155], [0.077, -0.155]]


@pytest.mark.parametrize("robot, values, told", [
    ("waffle", BURGERS, ["0.10 m out of the footprint that the local costmap of /move_base_flex has"]),
    ("burger", BURGERS, []),
    ("waffle", {"/move_base": {"footprint": WAFFLES, "local_costmap": {}}}, []),
    ("waffle", {"/move_base": {"local_costmap": {"robot_radius": 0.27}}}, []),
    ("waffle", {"/robot1/move_base": {"local_costmap": {"robot_radius": 0.15}}}, ["of /robot1/move_base has"]),
    ("waffle", {"/move_base": {"local_costmap": {"footprint": "nonsense"}}}, []),
])
def test_whoever_drives_a_waffle_for_a_burger_is_told_so(robot, values, told):
    """It touched what it was taken to pass, without a word."""
    lines = too_small_footprints(values, load_robot(robot))
    assert [part in line for part, line in zip(told, lines)] == [True] * len(told) == [True] * len(lines)


def test_who_drives_a_robot_is_found_in_its_namespace():
    names = ["/robot1/move_base/local_costmap/footprint", "/robot1/move_base/local_costmap/scan/topic", "/run_id",
             "/robot2/move_base_flex/local_costmap/width", "/local_costmap/width", "/robot1/amcl/seed"]
    assert drivers(names, "/robot1/") == {"/robot1/move_base"}
    assert drivers(names, "/") == {"/robot1/move_base", "/robot2/move_base_flex"}


@pytest.mark.parametrize("name", ["burger", "waffle", "car", "omni", "small", "medium", "large"])
def test_parameters_printed_for_a_robot_fit_it(name):
    robot = load_robot(name)
    made = parameters_for(robot)
    local = {**BURGERS["/move_base_flex"]["local_costmap"], **made["move_base_flex"]["local_costmap"]}
    assert not too_small_footprints({"/move_base_flex": {"local_costmap": local}}, robot)
    assert made["velocity_guard"]["footprint"] == robot.footprint.tolist()
