"""Ways of a robot that touches something where it begins: out of it, along it, and into nothing else."""

import dataclasses
import math

import numpy as np
import pytest
from kinematics import BURGER
from plain_footprint import random_costmap

from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D


def empty_costmap(footprint=BURGER):
    costmap = random_costmap(np.random.default_rng(1), obstacles=0, footprint=footprint)
    costmap.costs[:] = 0
    return dataclasses.replace(costmap, obstacle_overlap=0.2)


def beside(costmap, row, depth):
    """Return the y at which the left side is so deep (cells) in the cells of a row."""
    return costmap.grid.center_of(0, row)[1] + 0.05 * (depth - 0.3) - costmap.footprint[:, 1].max()


@pytest.mark.parametrize("step", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("depth", [0.05, 0.3, 0.7, 1.2])
def test_what_touches_its_side_is_no_leave_to_run_into_the_wall_ahead(depth, step):
    """It was driven as deep into the wall as what it touched was in its side, 4 cm, a little in each cycle."""
    costmap = empty_costmap()
    costmap.costs[:, 42:] = 254  # from x = 0.6 on
    costmap.costs[33, 39:41] = 254
    checker, pose = FootprintChecker(costmap), Pose2D(0.558, beside(costmap, 33, depth), 0.0)
    assert checker.depths_at(pose)[0] == pytest.approx(depth)
    for _ in range(400):
        ahead = np.array([[pose.x + step, pose.y, 0.0]])
        if checker.free_steps(ahead, pose):
            pose = Pose2D(*ahead[0])
    assert 0.608 < pose.x + 0.041 < 0.6101, "a fifth of a cell may be entered by any robot"


@pytest.mark.parametrize("depth", [0.05, 0.3, 0.7, 1.2])
@pytest.mark.parametrize("ahead", [1.0, -1.0])
def test_one_that_touches_the_end_of_a_wall_drives_along_all_of_it(depth, ahead):
    costmap = empty_costmap()
    costmap.costs[33, 20:42] = 254  # x from -0.5 to 0.6
    checker = FootprintChecker(costmap)
    pose = Pose2D(-0.44 if ahead > 0.0 else 0.6, beside(costmap, 33, depth), 0.0)
    assert checker.depths_at(pose)[0] == pytest.approx(depth)
    way = pose.transform_poses(np.column_stack((ahead * 0.005 * np.arange(1, 240), np.zeros((239, 2)))))
    assert checker.free_steps(way, pose) == 239


def test_one_between_two_walls_that_it_touches_drives_on():
    costmap = empty_costmap()
    costmap.costs[33, 10:50] = costmap.costs[29, 10:50] = 254
    checker, pose = FootprintChecker(costmap), Pose2D(-0.3, beside(costmap, 33, 0.4), 0.0)
    lower = costmap.grid.center_of(0, 29)[1]
    assert checker.contacts_at(pose) and 0.0 < 0.3 - (pose.y - 0.105 - lower) / 0.05 < 0.7
    way = pose.transform_poses(np.column_stack((0.005 * np.arange(1, 160), np.zeros((159, 2)))))
    assert checker.free_steps(way, pose) == 159


def test_a_round_robot_turns_beside_a_wall_that_it_touches():
    angles = 2.0 * math.pi * (np.arange(36) + 0.5) / 36
    costmap = empty_costmap(0.2 * np.column_stack((np.cos(angles), np.sin(angles))))
    costmap.costs[35:, :] = 254
    checker, pose = FootprintChecker(costmap), Pose2D(0.0, beside(costmap, 35, 0.4), 0.0)
    assert checker.contacts_at(pose)
    turns = np.column_stack((np.full((36, 2), pose[:2]), math.pi / 18.0 * np.arange(1, 37)))
    assert checker.free_steps(turns, pose) == 36
    nearer = pose.transform_poses(np.column_stack((np.zeros(20), 0.001 * np.arange(1, 21), np.zeros(20))))
    assert checker.free_steps(nearer, pose) == 0
