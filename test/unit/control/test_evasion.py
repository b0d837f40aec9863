"""Evasion: what is begun for those who come along, and what is left to the controller."""

import dataclasses

import numpy as np
import pytest
from kinematics import boxes, costmap_round, path_through
from paper import burger

from mbf_relay.control.braking import arcs_to_a_stand, brake_free, brakes_free
from mbf_relay.control.controller import SpeedLimit
from mbf_relay.control.evasion import DISTANCES, HEADINGS, Evasion, _manoeuvres
from mbf_relay.control.evasion_kernels import roll_out
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.local_path import PathTracker
from mbf_relay.control.space_time import BLOCKED, PRICE
from mbf_relay.control.state import ControlState
from mbf_relay.control.trajectories import window_of
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.tracking.track import Track

START, STANDS = Pose2D(0.0, 0.0, 0.0), STOP
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


def ways_out(manoeuvres, velocity=(0.0, 0.0), radius=0.0, seconds=12.0, period=0.05):
    """Return how manoeuvres, rows of turn (rad), distance (m) and whether it turns first, are driven from the origin.

    Each by a row of poses, and its speeds (m/s) and turns (rad/s) from step to step.
    """
    manoeuvres = np.array(manoeuvres, dtype=float)
    poses, first = np.empty((len(manoeuvres), round(seconds / period), 3)), np.empty((len(manoeuvres), 2))
    roll_out(np.zeros(3), np.array(velocity), manoeuvres, 0.8, 0.3, 1.5, radius, 1.0, 3.0, period, poses, first)
    moves = np.diff(poses, axis=1, prepend=0.0)
    middle = poses[..., 2] - 0.5 * moves[..., 2]
    speeds = (moves[..., 0] * np.cos(middle) + moves[..., 1] * np.sin(middle)) / period
    assert moves[..., 1] * np.cos(middle) == pytest.approx(moves[..., 0] * np.sin(middle)), "wheels roll ahead alone"
    assert np.column_stack((speeds[:, 0], moves[:, 0, 2] / period)) == pytest.approx(first)
    return poses, speeds, moves[..., 2] / period


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.5, -1.0), (-0.2, 1.2)])
def test_a_way_out_ends_where_it_should_within_what_the_wheels_can(velocity):
    """Backwards it was as fast as ahead, so that a robot that backs but slowly was told to flee so, and was caught."""
    manoeuvres = [(turn, way, first) for turn in (0.0, 0.8, -0.8, 2.5, -2.5) for way in (1.0, -0.6) for first in (0, 1)]
    poses, speeds, turns = ways_out(manoeuvres, velocity)
    turn, way, _ = np.array(manoeuvres).T
    assert poses[:, -1, 2] == pytest.approx(turn, abs=0.02)
    assert speeds.sum(axis=1) * 0.05 == pytest.approx(way, abs=0.02)
    assert np.abs(speeds[:, -1]).max() < 0.01 and np.abs(turns[:, -1]).max() < 0.02
    assert np.abs(np.diff(speeds, axis=1, prepend=velocity[0])).max() <= 0.05 * 1.0 + 1e-9
    assert np.abs(np.diff(turns, axis=1, prepend=velocity[1])).max() <= 0.05 * 3.0 + 1e-9
    assert speeds.max() == pytest.approx(0.8) and -0.35 < speeds.min() < -0.29 and np.abs(turns).max() <= 1.5 + 1e-9
    assert len(poses) == len(manoeuvres)


def test_a_way_out_is_the_mirror_image_of_that_to_the_other_side():
    for radius in (0.0, 0.4):
        left, right = (ways_out([(side * 1.2, 0.7, 0), (side * 1.2, -0.7, 1)], (0.2, side * 0.3), radius)[0]
                       for side in (1.0, -1.0))
        assert left == pytest.approx(right * (1.0, -1.0, -1.0))


def test_one_that_turns_on_the_spot_first_drives_when_it_faces_where_it_goes():
    poses, speeds, _ = ways_out([(2.0, 1.0, 1), (2.0, 1.0, 0)])
    left = 2.0 - poses[:, :-1, 2]
    assert (speeds[0, 1:][left[0] > 0.11] == 0.0).all() and speeds[0, 1:][left[0] < 0.09].max() > 0.5
    assert (speeds[1, 1:][left[1] > 0.11] > 0.0).all()
    assert np.hypot(*poses[0, -1, :2]) == pytest.approx(1.0, abs=0.02)


def test_a_car_turns_on_the_way_and_no_more_sharply_than_it_can():
    poses, speeds, turns = ways_out([(1.2, 1.5, 0), (1.2, -1.5, 0), (1.2, 0.0, 1)], radius=0.5)
    assert (np.abs(turns[:, 1:]) <= np.abs(speeds[:, :-1]) / 0.5 + 0.05 * 3.0 + 1e-9).all()
    assert poses[:2, -1, 2] == pytest.approx((1.2, 1.2), abs=0.02) and poses[2, -1].tolist() == [0.0, 0.0, 0.0]


def test_ways_out_lead_all_round_and_the_first_is_to_stand():
    for backwards, on_the_spot in ((True, True), (False, True), (True, False)):
        ways = _manoeuvres(0.4, backwards, on_the_spot)
        assert ways[0].tolist() == [0.0, 0.0, 1.0] and len(np.unique(ways, axis=0)) == len(ways)
        assert len(ways) == 1 + HEADINGS * len(DISTANCES) * (1 + backwards) * (1 + on_the_spot)
        assert np.diff(np.unique(ways[:, 0])) == pytest.approx(2.0 * np.pi / HEADINGS)
        assert -np.pi < ways[:, 0].min() and ways[:, 0].max() == pytest.approx(np.pi)
        lengths = np.unique(ways[1:, 1])
        assert lengths[lengths > 0.0] == pytest.approx(0.4 * np.array(DISTANCES))
        assert (lengths < 0.0).any() == backwards and set(ways[1:, 2]) == ({0.0, 1.0} if on_the_spot else {0.0})


def evasion_from(track, velocity, parameters=FAST, side=1.0, radius=0.0):
    """Return the evasion of a robot in the open whose path leads ahead, a little to a side, where somebody is about."""
    x, y, vx, vy = track
    costmap = dataclasses.replace(
        costmap_round(START, boxes(), now=0.0), tracks=(Track(1, 0.0, x, y, vx, vy, 0.15, 1e-4, 0.0, 1e-4),))
    state, tracker = ControlState(0.0, START, velocity, costmap, IDENTITY, 0.1), PathTracker()
    tracker.set_path(path_through((0.0, 0.0), (1.0, side * 0.3)))
    foresight = Foresight(costmap, START, 0.0, parameters)
    return Evasion(parameters, foresight, state, SpeedLimit(), radius, tracker.cut(state, 0.5, 1.5, 1.0))


@pytest.mark.parametrize("track, gives_way", [
    ((0.0, 0.8, 0.0, -0.5), True), ((0.3, 0.8, -0.1, -0.5), True), ((0.9, 0.1, -0.5, 0.0), True),
    ((-0.9, 0.9, 0.4, -0.4), True), ((0.0, 3.9, 0.0, 0.5), False), ((3.9, 0.0, 0.5, 0.5), False)])
@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_one_that_stands_gives_way_to_who_comes_and_alike_to_either_side(track, gives_way, radius):
    commands = []
    for side in (1.0, -1.0):
        x, y, vx, vy = track
        evasion = evasion_from((x, side * y, vx, side * vy), STANDS, side=side, radius=radius)
        commands.append(evasion.command(STANDS, STANDS))
    left, right = commands
    assert (left != STANDS) is gives_way
    assert left == pytest.approx((right.x, right.y, -right.theta))
    assert radius == 0.0 or abs(left.theta) <= abs(left.x) / radius + 1e-9


@pytest.mark.parametrize("velocity, angle, aside", [
    ((0.22, 1.5), 2.7, 0.4), ((0.22, 1.5), 3.0, 0.4), ((0.0, -2.0), -3.0, -0.4), ((0.15, -1.6), -3.0, -0.4)])
def test_one_that_moves_is_not_stopped_where_it_is_met_sooner_so(velocity, angle, aside):
    """It was stopped before who came from behind, for it would have been met later had it stood there already."""
    moving, parameters = Twist2D(velocity[0], 0.0, velocity[1]), burger(foresight=True)
    (x, y), (vx, vy) = (length * np.array((np.cos(way), np.sin(way)))
                        for length, way in ((0.35, angle), (0.4, angle + np.pi + aside)))
    evasion = evasion_from((x, y, vx, vy), moving, parameters)
    command = evasion.command(moving, moving)
    still = window_of(parameters, moving, 0.1, parameters.max_vel_trans, parameters.max_vel_theta).still
    arcs = arcs_to_a_stand(parameters, evasion._state, evasion._checker, np.array([command, still]))
    going_on, braking = evasion._foresight.meetings(*arcs)
    assert command.x > 0.2 and going_on > braking


@pytest.mark.parametrize("back", [0.05, 0.8])
def test_what_a_way_out_backwards_is_worth_goes_by_how_fast_the_robot_backs(back):
    parameters = burger(foresight=True, max_vel_x=0.6, max_vel_trans=0.8, min_vel_x=-back, acc_lim_x=1.0)
    evasion = evasion_from((0.9, 0.1, -0.5, 0.0), STANDS, parameters)
    poses, _ = evasion._driven(STANDS, np.array([[0.0, -2.0, 1.0], [0.0, 2.0, 1.0]]))
    speeds = np.abs(np.diff(poses[:, :, 0], axis=1)).max(axis=1) / evasion._step
    assert speeds[0] <= back + 1e-9 and 0.3 < speeds[1] <= 0.6 + 1e-9
    assert speeds[0] == pytest.approx(min(back, speeds[1]), abs=1e-9) or back == 0.8


def test_what_a_held_command_leads_to_is_its_arc():
    evasion = evasion_from((0.9, 0.1, -0.5, 0.0), STANDS)
    for wanted in (Twist2D(0.3, 0.0, 0.0), Twist2D(0.3, 0.0, 0.9), Twist2D(-0.2, 0.1, -0.7)):
        times = evasion._step * np.arange(1, evasion._steps + 1)
        assert evasion._steps * evasion._step == pytest.approx(evasion._cost_to_go.moment)
        assert evasion._held(wanted)[0] == pytest.approx(np.array([wanted.held(t) for t in times]), abs=1e-3)


def test_a_way_out_costs_by_how_long_it_is_in_somebody_s_way_and_in_obstacles_and_by_where_it_leads():
    evasion = evasion_from((0.4, 0.1, -0.5, 0.0), STANDS)
    poses, _ = evasion._driven(STANDS, evasion._manoeuvres[:40])
    costs, exposures = evasion._judged(poses)
    left = evasion._cost_to_go.at(poses[:, -1])
    assert exposures == pytest.approx(evasion._foresight.exposures(poses, evasion._step)) and exposures.max() > 0.1
    assert costs == pytest.approx(PRICE * exposures + left)
    evasion._checker = FootprintChecker(costmap_round(START, boxes((0.15, -2.0, 0.25, 2.0)), now=0.0))
    free = evasion._checker.first_contacts(poses, np.full(40, evasion._steps), np.ones(40), START).steps
    blocked = np.where(free < evasion._steps, BLOCKED * (1.0 + (evasion._steps - free) * evasion._step), 0.0)
    assert evasion._judged(poses)[0] == pytest.approx(costs + blocked) and 0 < np.count_nonzero(blocked) < 40


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_robot_whose_file_asks_for_gentle_braking_is_told_to_stand_before_somebody(turn):
    """It braked by the 0.05 m/s^2 of its file, and drove on for metres towards somebody who stood in its way."""
    gentle = dataclasses.replace(FAST, acc_lim_x=0.05, acc_lim_theta=0.1)
    velocity = Twist2D(0.6, 0.0, turn)
    costmap = dataclasses.replace(
        costmap_round(START, now=0.0), tracks=(Track(1, 0.0, 0.6, 0.0, -0.3, 0.0, 0.11, 1e-4, 0.0, 1e-4),))
    state, tracker = ControlState(0.0, START, velocity, costmap, IDENTITY, 0.1), PathTracker()
    tracker.set_path(path_through((0.0, 0.0), (2.0, 0.0)))
    evasion = Evasion(
        gentle, Foresight(costmap, START, 0.0, gentle), state, SpeedLimit(), 0.0, tracker.cut(state, 0.5, 1.5, 1.0))
    assert evasion.command(velocity, velocity) == STOP


@pytest.mark.parametrize("sees", [True, False])
def test_one_that_does_not_look_behind_itself_does_not_flee_there(sees):
    """A robot with a depth camera, which took the end of a wall for somebody, backed into a box at its top speed."""
    track = Track(1, 0.0, 0.4, 0.0, -0.3, 0.0, 0.2, 1e-4, 0.0, 1e-4)
    sides = boxes((-2.0, 0.25, 2.0, 0.35), (-2.0, -0.35, 2.0, -0.25))  # a corridor
    costmap = dataclasses.replace(costmap_round(START, sides, now=0.0), tracks=(track,), sees_all_round=sees)
    state, tracker = ControlState(0.0, START, STANDS, costmap, IDENTITY, 0.1), PathTracker()
    tracker.set_path(path_through((0.0, 0.0), (2.0, 0.0)))
    evasion = Evasion(
        FAST, Foresight(costmap, START, 0.0, FAST), state, SpeedLimit(), 0.0, tracker.cut(state, 0.5, 1.5, 1.0))
    assert (evasion.command(STANDS, STOP).x < 0.0) is sees
