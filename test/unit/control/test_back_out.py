"""Backing out of a place in which a robot can neither go on nor turn."""

import os
import sys

import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import make  # noqa: E402
from kinematics import boxes, costmap_round, path_through  # noqa: E402

from mbf_relay.control.back_out import PATIENCE, BackOut  # noqa: E402
from mbf_relay.control.local_path import PathTracker  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D  # noqa: E402

HERE, PERIOD = Pose2D(0.0, 0.0, 0.0), 0.1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_still_rolls_forward_brakes_and_turns_into_nothing_beside_it(side):
    """It turned as it would backwards while it still rolled forward: into the post it was to back away from."""
    parameters = make("dwa_local_planner/DWAPlannerROS").parameters
    wall = boxes((0.1, -2.0, 0.2, 2.0), (-2.0, side * 0.25, 0.2, side * 0.25 + 0.1))
    state = ControlState(0.0, HERE, Twist2D(0.2, 0.0, 0.0), costmap_round(HERE, wall), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (0.0, side * -1.0)))
    path = tracker.cut(state, 0.6, 1.0, 0.4)
    for now in (0.0, 1.01 * PATIENCE):
        back_out.failed(now, HERE, path, checker, parameters)
    assert back_out.is_active
    velocity, turned = Twist2D(1.0, 0.0, 0.0), []
    while velocity.x > -0.01:
        rolled = velocity.x
        velocity = back_out.command(HERE, velocity, checker, parameters, PERIOD)
        if velocity.x > 0.0:
            assert velocity.x == pytest.approx(rolled - PERIOD * parameters.acc_lim_x)
            turned.append(velocity.theta)
    assert len(turned) >= 2 and not any(turned), turned
    assert velocity.theta != 0.0, "backwards it takes an arc"
