"""Backing out of a place in which a robot can neither go on nor turn."""

import math
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import make  # noqa: E402
from kinematics import boxes, costmap_round, drive, path_through  # noqa: E402

from mbf_relay.control.back_out import PATIENCE, TRIES, BackOut  # noqa: E402
from mbf_relay.control.local_path import PathTracker  # noqa: E402
from mbf_relay.control.state import ControlState, SpeedLimit  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between  # noqa: E402

HERE, PERIOD, ANYWHERE = Pose2D(0.0, 0.0, 0.0), 0.1, SpeedLimit()


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
        velocity = back_out.command(HERE, velocity, checker, parameters, PERIOD, SpeedLimit())
        if velocity.x > 0.0:
            assert velocity.x == pytest.approx(rolled - PERIOD * parameters.acc_lim_x)
            turned.append(velocity.theta)
    assert len(turned) >= 2 and not any(turned), turned
    assert velocity.theta != 0.0, "backwards it takes an arc"


def driven(back_out, state, path, checker, parameters, limit=ANYWHERE):
    """Return the poses of a robot that does as it is told, until it is told nothing."""
    for now in (0.0, 1.01 * PATIENCE):
        back_out.failed(now, state.pose, path, checker, parameters)
    poses, velocity = [state.pose], state.velocity
    while len(poses) < 200 and back_out.is_active:
        velocity = back_out.command(poses[-1], velocity, checker, parameters, PERIOD, limit)
        if velocity is not None:
            poses.append(poses[-1].compose(Pose2D(velocity.x * PERIOD, 0.0, velocity.theta * PERIOD)))
    return poses


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_arc_that_is_driven_is_the_one_that_was_found_free(side):
    """It drove the arc's mirror image, which nobody had looked at, its face away from the path."""
    parameters = make("dwa_local_planner/DWAPlannerROS").parameters
    between = boxes((0.1, -2.0, 0.2, 2.0), (-2.0, 0.2, 0.2, 0.3), (-2.0, -0.3, 0.2, -0.2), (-0.5, -2.0, -0.4, 2.0))
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, between), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (-0.3, side * -0.05), (-0.3, side * -1.0)))
    poses = driven(back_out, state, tracker.cut(state, 0.6, 1.0, 0.4), checker, parameters)
    assert len(poses) > 5 and not checker.touches(np.array(poses)).any()
    assert poses[-1].distance_to(back_out.end) < 0.02
    assert back_out.end.theta != 0.0 and abs(angle_between(poses[-1].theta, back_out.end.theta)) < 0.1


@pytest.mark.parametrize("bend", [1.15, -1.15])
@pytest.mark.parametrize("limit", [ANYWHERE, SpeedLimit(rotation=0.1)], ids=["as fast as it may", "in a slow zone"])
def test_one_that_backs_out_along_a_bend_ends_where_it_was_found_free_to_turn(monkeypatch, bend, limit):
    """It went on till it was as far off as the bend is long, and where it may turn but slowly it went nearly straight.
    """
    monkeypatch.setattr("mbf_relay.control.back_out.CURVATURES", np.array([bend]))
    monkeypatch.setattr("mbf_relay.control.back_out.LEAST", 1.4)
    parameters = make("dwa_local_planner/DWAPlannerROS").parameters
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, boxes()), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (0.0, math.copysign(1.0, bend))))
    poses = driven(back_out, state, tracker.cut(state, 0.6, 1.0, 0.4), checker, parameters, limit)
    assert abs(back_out.end.theta) > 1.0, "it bends"
    assert poses[-1].distance_to(back_out.end) < 0.02
    assert abs(angle_between(poses[-1].theta, back_out.end.theta)) < 0.15


def test_one_that_may_not_turn_backs_straight_out(monkeypatch):
    monkeypatch.setattr("mbf_relay.control.back_out.LEAST", 1.4)
    parameters = make("dwa_local_planner/DWAPlannerROS", max_vel_theta=0.0).parameters
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, boxes()), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (0.0, 1.0)))
    poses = driven(back_out, state, tracker.cut(state, 0.6, 1.0, 0.4), checker, parameters)
    assert not back_out.is_active and poses[-1].distance_to(back_out.end) < 0.02


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_can_only_drive_ahead_out_of_a_corner_does(side):
    """In a corner, its back and its side to walls and the way off to the other side, it stood until it was given up."""
    parameters = make("dwa_local_planner/DWAPlannerROS").parameters
    corner = boxes((-0.25, -2.0, -0.15, 2.0), (-2.0, side * -0.25, 2.0, side * -0.15))
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, corner), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (0.0, side * 1.0)))
    poses = driven(back_out, state, tracker.cut(state, 0.6, 1.0, 0.4), checker, parameters)
    assert len(poses) > 2 and not checker.touches(np.array(poses)).any()
    assert poses[-1].x > 0.02 and side * poses[-1].theta > 0.05


@pytest.fixture
def wedged():
    """A robot in a slot as wide as it, its face to the end; its state, the obstacles, and how a path is cut for it."""
    slot = boxes((0.1, -2.0, 0.2, 2.0), (-2.0, 0.14, 0.2, 0.24), (-2.0, -0.24, 0.2, -0.14))
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, slot), IDENTITY, PERIOD)

    def cut(*points):
        tracker = PathTracker()
        tracker.set_path(path_through(*points))
        return tracker.cut(state, 0.6, 1.0, 0.4)

    return state, FootprintChecker(state.costmap), cut


@pytest.mark.parametrize("has_driven_in", [False, True], ids=["by an arc", "the way it came"])
def test_a_zone_s_speed_limit_holds_for_backing_out_as_well(has_driven_in):
    """It rolled backwards and turned as fast as anywhere."""
    controller, limit = make("regulated_pure_pursuit", min_vel_x=-0.22), SpeedLimit(0.03, 0.1)
    slot = boxes((0.1, -2.0, 0.2, 2.0), (-0.5, 0.14, 0.2, 0.24), (-0.5, -0.24, 0.2, -0.14))
    if has_driven_in:
        drive(controller, path_through((-0.3, 0.0), (0.0, 0.0)), Pose2D(-0.3, 0.0, 0.0), slot)
    controller.limit_speed(limit, "zone")
    ended = drive(controller, path_through((0.0, 0.0), (-1.0, 0.3)), HERE, slot, seconds=6.0)
    assert ended.commands and min(command.x for command in ended.commands) < 0.0, "it backs out"
    assert max(command.speed() for command in ended.commands) <= limit.translation + 1e-9
    assert max(abs(command.theta) for command in ended.commands) <= limit.rotation + 1e-9


@pytest.mark.parametrize("name", ["dwa_local_planner/DWAPlannerROS", "regulated_pure_pursuit", "mppi"])
def test_one_that_backs_out_shows_no_trajectory_ahead(name):
    """RViz showed, and the log explained, the drive into the wall that had failed before, all the way out."""
    controller, shown = make(name, min_vel_x=-0.22), []
    controller.watcher = lambda report: shown.append((controller.command, report))
    slot = boxes((0.1, -2.0, 0.2, 2.0), (-0.5, 0.14, 0.2, 0.24), (-0.5, -0.24, 0.2, -0.14))
    drive(controller, path_through((0.0, 0.0), (-1.0, 0.3)), HERE, slot, seconds=2.0)
    backwards = [report for command, report in shown if command.x < 0.0]
    assert len(backwards) > 5, "it backs out"
    assert not any(len(report.trajectory) or report.explanation or report.trajectories for report in backwards)


def tried(back_out, state, path, checker, parameters):
    """Return how far (m) the next try leads from where the robot stands, None where there is none."""
    for now in (0.0, 1.01 * PATIENCE):
        back_out.failed(now, state.pose, path, checker, parameters)
    if not back_out.is_active:
        return None
    while back_out.command(back_out.end, Twist2D(0.0, 0.0, 0.0), checker, parameters, PERIOD, SpeedLimit()) is not None:
        pass
    return back_out.end.distance_to(state.pose)


def test_one_whose_try_brought_it_nowhere_backs_out_farther_the_next_time(wedged):
    """It took the shortest way again and again, five centimetres of it, and stood there until it was given up."""
    (state, checker, cut), back_out = wedged, BackOut()
    parameters = make("dwa_local_planner/DWAPlannerROS").parameters
    tries = [tried(back_out, state, cut((0.0, 0.0), (0.0, 1.0)), checker, parameters) for _ in range(3)]
    assert tries[1] > 1.5 * tries[0] and (tries[2] > 1.5 * tries[1] or tries[2] > state.costmap.width), tries


@pytest.mark.parametrize("gets_on", [True, False])
def test_one_that_is_led_another_way_may_back_out_again(wedged, gets_on):
    """It had used up its tries before a gap, and in the dead end behind it stood until it was given up.

    Where it could not make a move towards the other way either, it stood right there.
    """
    (state, checker, cut), back_out, parameters = wedged, BackOut(), make("dwa_local_planner/DWAPlannerROS").parameters
    ahead, round_about = cut((0.0, 0.0), (0.0, 0.5)), cut((0.0, 0.0), (-0.5, 0.0), (-0.5, 2.0))
    for _ in range(TRIES):
        assert tried(back_out, state, ahead, checker, parameters) is not None
        back_out.drove(ahead, state.costmap.width)
    assert tried(back_out, state, ahead, checker, parameters) is None
    if gets_on:
        back_out.drove(round_about, state.costmap.width)
    assert tried(back_out, state, round_about, checker, parameters) is not None


@pytest.mark.parametrize("top", [0.22, 0.8])
def test_one_that_is_fast_can_brake_before_what_stands_behind_the_arc(top):
    """It took the few centimetres it had found free at half its top speed, and with that what stood behind them, too.
    """
    parameters = make("dwa_local_planner/DWAPlannerROS", max_vel_x=top, max_vel_trans=top, min_vel_x=-top).parameters
    slot = boxes((0.06, -0.5, 0.16, 0.5), (-0.33, -0.5, -0.23, 0.5))
    state = ControlState(0.0, HERE, Twist2D(0.0, 0.0, 0.0), costmap_round(HERE, slot), IDENTITY, PERIOD)
    checker, tracker, back_out = FootprintChecker(state.costmap), PathTracker(), BackOut()
    tracker.set_path(path_through((0.0, 0.0), (0.0, 1.0)))
    path = tracker.cut(state, 0.6, 1.0, 0.4)
    for now in (0.0, 1.01 * PATIENCE):
        back_out.failed(now, HERE, path, checker, parameters)
    pose, velocity = HERE, Twist2D(0.0, 0.0, 0.0)
    while back_out.is_active:
        told = back_out.command(pose, velocity, checker, parameters, PERIOD, SpeedLimit())
        velocity = told if told is not None else velocity
        pose = pose.compose(Pose2D(velocity.x * PERIOD, 0.0, velocity.theta * PERIOD))
    stop = math.copysign(velocity.x ** 2 / (2.0 * parameters.acc_lim_x), velocity.x)
    assert pose != HERE and not checker.touches(np.array([pose, pose.compose(Pose2D(stop, 0.0, 0.0))])).any()
