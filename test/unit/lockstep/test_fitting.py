"""Parameters fitted to another robot: to its length, its width and its wheels."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.fitting import fitted
from mbf_relay.lockstep.settings import config_folder, load_settings
from mbf_relay.lockstep.setup import KNOWN, TRUTH, make_setup
from mbf_relay.lockstep.tasks import circle, task_of
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.worlds_file import world_of

LONG = """
drive: differential
base_height: 0.08
body: [{{box: [{length}, 0.38, 0.2], at: [0.0, 0.0, 0.1], mass: 15.0}}]
wheels: {{radius: 0.08, width: 0.03, separation: 0.3, mass: 0.5}}
casters: [{{at: [{caster}, 0.0], radius: 0.04}}, {{at: [-{caster}, 0.0], radius: 0.04}}]
lidar: {{at: [0.1, 0.0, 0.25]}}
footprint: [[-{nose}, -0.2], [-{nose}, 0.2], [{nose}, 0.2], [{nose}, -0.2]]
max_speed: 0.5
max_turn_rate: 1.5
wheel_acceleration: 1.0
wheel_torque: 20.0
scan_rate: 10
scan_beams: 360
scan_range_max: 8.0
scan_resolution: 0.0
"""
"""A robot 0.4 m wide that turns about its middle."""


def long_robot(folder, length):
    file = folder / f"long_{length}.yaml"
    file.write_text(LONG.format(length=length - 0.02, nose=length / 2.0, caster=length / 2.0 - 0.07))
    return str(file)


def corridor(width, start_y):
    """Return two rooms that a corridor 4 m long joins; the robot starts beside its axis."""
    low, high = 2.05 - width / 2.0, 4.0 - (2.05 + width / 2.0)
    return task_of(world_of(Path("corridor.json"), 0, {
        "name": "corridor", "start": [1.2, start_y, 0.0], "goal": [7.9, 1.0, 1.57], "goal_radius": 0.3,
        "time_limit": 60.0, "boxes": [
            [4.5, low / 2.0, 0.0, 4.0, low, 1.0], [4.5, 4.0 - high / 2.0, 0.0, 4.0, high, 1.0],
            [4.5, -0.1, 0.0, 9.4, 0.2, 1.0], [4.5, 4.1, 0.0, 9.4, 0.2, 1.0],
            [-0.1, 2.0, 0.0, 0.2, 4.0, 1.0], [9.1, 2.0, 0.0, 0.2, 4.0, 1.0]]}))


@pytest.mark.parametrize("width, start_y", [(0.65, 1.5), (0.7, 2.9)])
def test_a_long_robot_gets_into_a_corridor_it_fits_in_lengthwise_only(tmp_path, width, start_y):
    """By cells a quarter of its width it found no velocity at the mouth, though in it 12 cm are free to both sides."""
    setup = make_setup(config_folder(), TRUTH, KNOWN, robot=long_robot(tmp_path, 0.9))
    driven = Episode(corridor(width, start_y), setup, 1).run()
    assert (driven.outcome, driven.contacts) == (outcomes.SUCCEEDED, 0), driven.message


@pytest.mark.parametrize("length", [0.4, 0.7, 0.9, 1.3])
def test_cells_are_as_fine_for_a_long_robot_as_for_a_short_one_of_its_width(tmp_path, length):
    settings = load_settings(config_folder())
    server = fitted(settings, load_robot(long_robot(tmp_path, length)))["move_base_flex"]
    assert server["local_costmap"]["resolution"] == 2.0 * settings["move_base_flex"]["local_costmap"]["resolution"]


@pytest.mark.parametrize("width, cell", [(0.19, 0.025), (0.1, 0.0125), (0.068, 0.025 / 3.0), (0.02, 0.00625)])
def test_cells_are_finer_for_a_robot_that_is_narrower(width, cell):
    """One of 7 cm saw gaps by cells of 2.5 cm, wandered before doorways and touched their jambs."""
    half = width / 2.0
    robot = dataclasses.replace(
        load_robot("burger"), footprint=np.array([[-half, -half], [-half, half], [half, half], [half, -half]]))
    server = fitted(load_settings(config_folder()), robot)["move_base_flex"]
    assert server["local_costmap"]["resolution"] == pytest.approx(cell)


@pytest.mark.parametrize("name", ["large", "medium", "omni", "small", "waffle"])
def test_no_wheel_is_asked_for_more_than_it_can_when_a_robot_turns_while_it_drives(name):
    """It went on turning for a second after it was told not to, and touched a wall's end."""
    robot = load_robot(name)
    server = fitted(load_settings(config_folder()), robot)["move_base_flex"]
    arm = math.hypot(robot.wheels.separation, robot.wheels.base) / 2.0
    for controller, straight, turning in (
        ("DWAPlannerROS", "acc_lim_x", "acc_lim_theta"), ("MPPI", "ax_max", "az_max"),
    ):
        rim = server[controller][straight] + arm * server[controller][turning]
        assert rim == pytest.approx(robot.settings["wheel_acceleration"])


def test_a_car_that_turns_round_between_pillars_is_not_said_to_oscillate():
    """It takes eleven seconds for it, hardly leaving its place; after ten it was stopped, and its costmaps cleared."""
    goals = Pose2D(-0.55, -0.55, 0.0), Pose2D(-0.55, -0.55, math.pi)
    task = dataclasses.replace(circle(), goals=goals)
    result = Episode(task, make_setup(config_folder(), robot="car"), seed=1).run()
    assert result.success and result.contacts == 0 and result.recoveries == 0
