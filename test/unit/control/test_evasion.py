"""Evasion: what is begun for those who come along, and what is left to the controller."""

import dataclasses

import numpy as np
import pytest
from kinematics import boxes, costmap_round, path_through
from paper import burger

from mbf_relay.control.braking import arcs_to_a_stand, brake_free, brakes_free
from mbf_relay.control.controller import SpeedLimit
from mbf_relay.control.evasion import Evasion
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.local_path import PathTracker
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D
from mbf_relay.tracking.track import Track

START = Pose2D(0.0, 0.0, 0.0)
FAST = burger(foresight=True, max_vel_x=0.8, max_vel_trans=0.8, acc_lim_x=1.0)


def commanded(track, velocity, wall):
    """Return what is commanded before a wall so many metres ahead, what was to be, and the state.

    The robot is about to brake on its arc; its path leads off to the right.
    """
    blocks = boxes((wall, -2.0, wall + 0.1, 2.0))
    costmap = dataclasses.replace(costmap_round(START, blocks, now=0.0), tracks=(Track(1, 0.0, *track),))
    state, tracker = ControlState(0.0, START, velocity, costmap, IDENTITY, 0.1), PathTracker()
    tracker.set_path(path_through((0.0, 0.0), (0.3, -0.1), (0.4, -1.5)))
    path, foresight = tracker.cut(state, 0.5, 1.5, 1.0), Foresight(costmap, START, 0.0, FAST)
    left = 1.0 - 0.1 / velocity.x
    braking = Twist2D(left * velocity.x, 0.0, left * velocity.theta)
    evasion = Evasion(FAST, foresight, state, SpeedLimit(), 0.0, path)
    return evasion.command(velocity, braking), braking, state


@pytest.mark.parametrize("speed", [0.4, 0.5, 0.6])
@pytest.mark.parametrize("turn", [0.0, -0.5])
def test_one_that_brakes_before_a_wall_is_not_sped_up_for_somebody_far_behind_it(speed, turn):
    """It was driven on at its top speed, into a box beyond the moment for which ways out are looked at."""
    far = (-3.8, 0.0, -0.1, 0.3, 0.37, 1e-4, 0.0, 1e-4)
    command, braking, _ = commanded(far, Twist2D(speed, 0.0, turn), 0.5)
    assert command == braking


@pytest.mark.parametrize("wall", np.arange(0.1, 0.5, 0.05))
@pytest.mark.parametrize("place", [(-0.7, -0.2, 0.02, 0.05), (-0.5, 0.4, 0.5, -0.3), (0.0, -0.5, 0.0, 0.3)])
def test_one_that_cannot_brake_before_a_wall_any_more_is_not_sped_up_for_somebody_beside_it(wall, place):
    """All ways out led into the wall, and it began the one that did so as late as could be: by speeding up."""
    for speed in (0.3, 0.45, 0.6):
        for turn in (0.0, -0.5, -1.0):
            track = (*place, 0.11, 1e-4, 0.0, 1e-4)
            command, _, state = commanded(track, Twist2D(speed, 0.0, turn), wall)
            checker = FootprintChecker(state.costmap)
            assert command.speed() < speed or brakes_free(FAST, state, checker, command)


def test_commands_brake_free_together_as_each_alone_does():
    costmap = costmap_round(START, boxes((0.2, -2.0, 0.3, 2.0), (-0.3, -2.0, -0.2, 2.0)), now=0.0)
    state = ControlState(0.0, START, Twist2D(0.0, 0.0, 0.0), costmap, IDENTITY, 0.1)
    checker, rng = FootprintChecker(state.costmap), np.random.default_rng(3)
    commands = rng.uniform((-0.8, 0.0, -2.7), (0.8, 0.0, 2.7), (200, 3))
    alone = [brakes_free(FAST, state, checker, Twist2D(*command)) for command in commands.tolist()]
    together = brake_free(state, checker, arcs_to_a_stand(FAST, state, checker, commands))
    assert together.tolist() == alone and 20 < sum(alone) < 180
