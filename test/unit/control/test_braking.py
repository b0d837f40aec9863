"""How a robot that can go nowhere any more comes to a stop."""

import dataclasses
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import make  # noqa: E402
from kinematics import boxes, costmap_round, path_through  # noqa: E402

from mbf_relay.control.braking import arcs_to_a_stand  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.control.trajectories import MOST_POSES  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D  # noqa: E402
from mbf_relay.outcomes import ControlError  # noqa: E402

HERE, PERIOD, TOP = Pose2D(0.0, 0.0, 0.0), 0.1, 0.8
FOLLOWERS = ("dwa_local_planner/DWAPlannerROS", "regulated_pure_pursuit")


NEAR = (0.08, -2.0, 0.2, 2.0), (-2.0, 0.14, 2.0, 0.3), (-2.0, -0.3, 2.0, -0.14)
WITHIN_THE_WAY_TO_STOP = (
    (0.25, -2.0, 0.4, 2.0), (-2.0, 0.3, 2.0, 0.45), (-2.0, -0.45, 2.0, -0.3), (-0.4, -2.0, -0.25, 2.0))


def shut_in(name, velocity, walls=NEAR, **changes):
    """Return a controller, and its state at a velocity with walls so near that nothing is left to drive."""
    controller = make(name, max_vel_x=TOP, max_vel_trans=TOP, acc_lim_x=1.0, **changes)
    controller.set_path(path_through((0.0, 0.0), (2.0, 0.0)), True)
    return controller, ControlState(0.0, HERE, velocity, costmap_round(HERE, boxes(*walls)), IDENTITY, PERIOD)


@pytest.mark.parametrize("name", FOLLOWERS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_can_go_nowhere_any_more_stops_along_its_curve(name, side):
    """Told to stand at once each wheel braked as hard as it could, and it turned on: into a wall beside the curve."""
    velocity = Twist2D(TOP, 0.0, side * 1.9)
    controller, state = shut_in(name, velocity, WITHIN_THE_WAY_TO_STOP)
    command = controller.compute_velocity(state)
    assert 0.0 < command.x < velocity.x
    assert command.theta / command.x == pytest.approx(velocity.theta / velocity.x)


@pytest.mark.parametrize("ahead, aside", [(0.7, 0.2), (-0.7, 0.2), (0.2, -0.7)])
def test_one_that_drives_sideways_stops_along_the_way_it_looked_along(ahead, aside):
    """The slower of the two ended first, and the robot went on ahead: into a box beside the way it was on."""
    velocity = Twist2D(ahead, aside, 0.1)
    controller, state = shut_in(
        FOLLOWERS[0], velocity, WITHIN_THE_WAY_TO_STOP, max_vel_y=TOP, min_vel_x=-TOP, min_vel_y=-TOP, acc_lim_y=1.0,
        vy_samples=5)
    command = controller.compute_velocity(state)
    assert 0.0 < command.speed() < velocity.speed()
    assert np.array(command) / command.speed() == pytest.approx(np.array(velocity) / velocity.speed())


@pytest.mark.parametrize("name", FOLLOWERS)
def test_one_that_can_go_nowhere_any_more_stands_however_slowly_it_may_drive(name):
    """It drove on along its curve at min_vel_x, into the wall; told to stand there it never did, and circled its goal.
    """
    controller, state = shut_in(name, Twist2D(TOP, 0.0, 1.9), min_vel_x=0.2)
    with pytest.raises(ControlError):
        for _ in range(round(TOP / PERIOD) + 2):
            state = dataclasses.replace(state, now=state.now + PERIOD, velocity=controller.compute_velocity(state))
    assert controller.command == STOP


@pytest.mark.parametrize("name", FOLLOWERS)
def test_one_that_can_go_nowhere_any_more_and_drives_straight_or_stands_says_so_at_once(name):
    for velocity in (Twist2D(TOP, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)):
        controller, state = shut_in(name, velocity)
        with pytest.raises(ControlError):
            for _ in range(3):
                controller.compute_velocity(state)


@pytest.mark.parametrize("name", FOLLOWERS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_whose_file_asks_for_gentle_braking_does_not_drive_on_into_what_it_sees(name, side):
    """It braked by the 0.05 m/s^2 of its file while its footprint lay on an obstacle already, for 2 s, and hit it."""
    controller, state = shut_in(name, Twist2D(0.3, 0.0, side * 0.2), WITHIN_THE_WAY_TO_STOP, acc_lim_theta=0.1)
    controller.reconfigure(dataclasses.replace(controller.parameters, acc_lim_x=0.05))
    driven = 0.0
    with pytest.raises(ControlError):
        while driven < 1.0:
            command = controller.compute_velocity(state)
            pose = state.pose.compose(Pose2D(PERIOD * command.x, 0.0, PERIOD * command.theta))
            state = dataclasses.replace(state, now=state.now + PERIOD, pose=pose, velocity=command)
            driven += PERIOD * command.x
            assert not FootprintChecker(state.costmap).contacts_at(pose)
    assert driven > 0.0


def test_a_robot_that_hardly_brakes_is_not_followed_for_a_hundred_million_poses():
    """A hundred ways out were each followed to a stand after eight minutes of turning: gigabytes, and no velocity."""
    parameters = make("dwa_local_planner/DWAPlannerROS", max_vel_theta=2.75, acc_lim_theta=0.003).parameters
    state = ControlState(0.0, HERE, STOP, costmap_round(HERE, resolution=0.01), IDENTITY, 10.0)
    turns = np.column_stack((np.zeros((100, 2)), np.linspace(2.0, 2.75, 100)))
    with pytest.raises(ControlError, match="raise .* acceleration limits"):
        arcs_to_a_stand(parameters, state, FootprintChecker(state.costmap), turns)
    arcs = arcs_to_a_stand(parameters, state, FootprintChecker(state.costmap), 0.1 * turns)
    assert 10_000 < arcs.counts.sum() <= MOST_POSES


def swinging(occupied, velocity, side, period=PERIOD):
    """Return what becomes of the command to swing round to a side at 0.78 m/s, and that command."""
    controller = make(
        "regulated_pure_pursuit", max_vel_x=TOP, max_vel_trans=TOP, desired_linear_vel=TOP, acc_lim_x=0.74)
    asked = []

    def drive(cycle):
        asked.append(cycle.window.clip(Twist2D(0.78, 0.0, side * 2.45)))
        return asked[-1]

    controller.drive = drive
    controller.set_path(path_through((0.0, 0.0), (2.0, 0.0)), True)
    command = controller.compute_velocity(
        ControlState(0.0, HERE, velocity, costmap_round(HERE, occupied), IDENTITY, period))
    return command, asked[0]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_swings_round_an_obstacle_keeps_room_to_stop_for_what_stands_behind(side):
    """What the arc's inner corner was to sweep over showed when it was nearer than the way to a stand: it hit a box."""
    velocity = Twist2D(0.73, 0.0, side * 2.3)
    low, high = sorted((side * 0.18, side * 0.46))
    command, _ = swinging(boxes((-0.14, low, 0.14, high)), velocity, side)
    assert command.x == pytest.approx(velocity.x - 0.074)
    assert command.theta / command.x == pytest.approx(velocity.theta / velocity.x)
    in_the_open, asked = swinging(boxes(), velocity, side)
    assert in_the_open == asked and asked.x > velocity.x


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_stands_beside_an_obstacle_drives_on_though_it_does_not_see_behind(side):
    low, high = sorted((side * 0.13, side * 0.46))
    command, asked = swinging(boxes((-0.14, low, 0.14, high)), STOP, side)
    assert command == asked and command.speed() > 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_stands_and_would_swing_over_what_it_does_not_see_creeps_on_until_it_does(side):
    """By cycles of a second each command led out of sight: it was told to stand each time, and stood for minutes."""
    low, high = sorted((side * 0.18, side * 0.46))
    command, asked = swinging(boxes((-0.14, low, 0.14, high)), STOP, side, period=1.0)
    assert 0.0 < command.speed() < asked.speed()
    assert command.theta / command.x == pytest.approx(asked.theta / asked.x)
