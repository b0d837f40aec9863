"""Cutting out the path round the robot, and refusing what is no path."""

import dataclasses
import math

import numpy as np
import paper  # noqa: F401  (finds the helpers above)
import pytest
from kinematics import costmap_round, path_through
from plain_footprint import random_costmap

from mbf_relay.control import path_kernels
from mbf_relay.control.local_path import PathTracker
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.planning.path import Path

COSTMAP = random_costmap(np.random.default_rng(1))


def state(x, y, theta=0.0, costmap_from_path=Pose2D(0.0, 0.0, 0.0)):
    return ControlState(0.0, Pose2D(x, y, theta), Twist2D(0.0, 0.0, 0.0), COSTMAP, costmap_from_path)


def tracker_on(points):
    tracker = PathTracker()
    tracker.set_path(Path(np.column_stack((np.array(points, float), np.zeros(len(points)))), "odom"))
    return tracker


def line(*corners, spacing=0.01):
    points = []
    for start, end in zip(np.array(corners, float)[:-1], np.array(corners, float)[1:]):
        count = int(np.hypot(*(end - start)) / spacing)
        points += [start + (end - start) * i / count for i in range(count)]
    return points + [np.array(corners[-1], float)]


def test_the_stretch_reaches_as_far_as_asked_and_straight_beyond_the_goal():
    path = tracker_on(line((0, 0), (2, 0))).cut(state(0.5, 0.1), 0.3, 0.6, 1.0)
    assert (path.robot_arc, path.robot_distance) == pytest.approx((0.5, 0.1), abs=1e-6)
    assert path.arcs[0] == pytest.approx(0.2, abs=0.03) and path.arcs[-1] == pytest.approx(1.1, abs=0.03)
    assert path.remaining == pytest.approx(1.5)
    end = tracker_on(line((0, 0), (2, 0))).cut(state(1.9, 0.0), 0.3, 0.6, 1.0)
    assert end.points[-1] == pytest.approx([3.0, 0.0]) and end.goal_arc == pytest.approx(2.0)
    assert end.point_at(2.5) == pytest.approx([2.5, 0.0])


@pytest.mark.parametrize("there", [(2.3, 0.0), (2.1, 0.4), (2.02, -0.2)])
def test_a_robot_beyond_the_goal_is_led_back_to_it_and_straight_on(there):
    transform = Pose2D(1.0, -2.0, 0.7)
    robot, goal = transform.compose(Pose2D(*there, 1.0)), transform.compose(Pose2D(2.0, 0.0, 0.0))
    way = np.array([goal.x - robot.x, goal.y - robot.y])
    path = tracker_on(line((0, 0), (2, 0))).cut(state(robot.x, robot.y, robot.theta, transform), 0.3, 0.6, 1.0)
    assert path.remaining == pytest.approx(np.hypot(*way)) == pytest.approx(path.robot_distance)
    assert path.goal_arc == pytest.approx(2.0) and path.goal.distance_to(goal) < 1e-9
    assert path.point_at(path.robot_arc) == pytest.approx([robot.x, robot.y])
    assert path.point_at(2.0) == pytest.approx([goal.x, goal.y])
    assert path.point_at(2.5) == pytest.approx([goal.x, goal.y] + 0.5 * way / np.hypot(*way))
    assert len(path.points) > 5, "an obstacle between is to be found"


def test_frames_are_related_by_the_transform():
    transform = Pose2D(1.0, -2.0, 0.7)
    robot = transform.compose(Pose2D(0.4, 0.05, 0.0))
    path = tracker_on(line((0, 0), (1, 0))).cut(state(robot.x, robot.y, robot.theta, transform), 0.2, 0.2, 0.1)
    assert (path.robot_arc, path.robot_distance) == pytest.approx((0.4, 0.05), abs=1e-6)
    assert path.point_at(0.5) == pytest.approx(transform.transform_points(np.array([[0.5, 0.0]]))[0])


def test_a_path_that_comes_back_beside_itself_is_followed_in_order():
    tracker = tracker_on(line((0, 0), (1, 0), (1, 0.12), (0, 0.12)))
    assert tracker.cut(state(0.3, 0.0), 0.1, 0.1, 0.1).robot_arc == pytest.approx(0.3, abs=0.01)
    assert tracker.cut(state(0.5, 0.07), 0.1, 0.1, 0.1).robot_arc == pytest.approx(0.5, abs=0.02), "not the way back"
    for x in np.arange(0.5, 1.01, 0.1):
        tracker.cut(state(x, 0.03), 0.1, 0.1, 0.1)
    assert tracker.cut(state(0.8, 0.1), 0.1, 0.1, 0.1).robot_arc == pytest.approx(1.3, abs=0.06)


def test_what_is_shown_of_a_path_that_turns_back_ends_where_it_does_until_the_robot_is_there():
    poses = [(x, y, 3.0) for x, y in line((0, 0), (1, 0), (0, 0), (0, 1))]  # it backs up to its first end
    tracker = PathTracker()
    tracker.set_path(Path(np.array(poses), "odom"))
    ahead = tracker.cut(state(0.5, 0.05), 0.3, 3.0, 0.2, 0.1)
    assert (ahead.robot_arc, ahead.remaining) == pytest.approx((0.5, 0.5), abs=0.02) and not tracker.is_on_last_leg
    assert ahead.goal == pytest.approx((1.0, 0.0, 3.0), abs=0.02)
    assert ahead.points[-1] == pytest.approx([1.2, 0.0], abs=0.02)
    assert tracker.cut(state(0.85, 0.0), 0.3, 3.0, 0.2, 0.1).remaining == pytest.approx(0.15, abs=0.02)
    back = tracker.cut(state(0.95, 0.0), 0.3, 3.0, 0.2, 0.1)
    assert (back.robot_arc, back.arcs[0], back.remaining) == pytest.approx((1.05, 1.0, 1.95), abs=0.03)
    assert tracker.is_on_last_leg and back.goal == pytest.approx((0.0, 1.0, 3.0))
    assert tracker.remaining(state(0.5, 0.0)) == pytest.approx(1.5, abs=0.03)


@pytest.mark.parametrize("spacing", [0.01, 1.0], ids=["many poses", "its corners"])
def test_a_path_to_and_fro_is_followed_to_each_of_its_ends_however_many_poses_it_has(spacing):
    """A client that sends a way to and fro by its corners was led to the first of them, then to the end."""
    tracker = tracker_on(line((0, 0), (1, 0), (0, 0), (1, 0), (0, 0), spacing=spacing))
    for x, end in zip((0.5, 0.98, 0.02, 0.98), (1.0, 0.0, 1.0, 0.0)):
        assert tracker.cut(state(x, 0.0), 0.3, 3.0, 0.2, 0.05).goal[:2] == pytest.approx((end, 0.0), abs=0.02)
    assert tracker.is_on_last_leg


def test_a_costmap_that_becomes_coarser_on_the_way_does_not_end_the_drive():
    """Of short ways to and fro fewer are seen on it; the leg that the robot was on was none any more."""
    corners = [(0.3 * (number % 2), 0.01 * number) for number in range(6)]
    tracker = tracker_on(line(*corners))
    for x, y in corners:
        tracker.cut(state(x, y), 0.3, 3.0, 0.2, 0.05)
    coarse = dataclasses.replace(
        COSTMAP, grid=Grid(0.5, -5.0, -5.0, 20, 20), costs=np.zeros((20, 20), dtype=np.uint8))
    here = dataclasses.replace(state(*corners[-1]), costmap=coarse)
    assert tracker.cut(here, 0.3, 3.0, 0.2, 0.05).remaining < 0.1 and tracker.is_on_last_leg


def test_a_robot_that_goes_round_something_on_its_way_back_is_not_taken_for_one_on_its_way_there():
    tracker = tracker_on(line((0, 0), (1, 0), (0, 0)))
    tracker.cut(state(1.0, 0.0), 0.3, 3.0, 0.2, 0.1)
    for there in ((0.8, 0.2), (0.5, 0.4), (0.2, 0.2)):
        assert tracker.cut(state(*there), 0.3, 3.0, 0.2, 0.1).robot_arc == pytest.approx(2.0 - there[0], abs=0.03)


def test_a_robot_set_down_on_another_leg_is_found_there():
    tracker = tracker_on(line((0, 0), (3, 0), (0, 0.4), (3, 3)))
    tracker.cut(state(0.5, 0.0), 0.3, 1.0, 0.2, 0.1)
    assert tracker.cut(state(2.9, 2.9), 0.3, 1.0, 0.2, 0.1).remaining < 0.3 and tracker.is_on_last_leg


@pytest.mark.parametrize("corners", [
    ((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 0), (0.5, 0.6)), ((0, 0), (1, 0), (1, 0.2), (0, 0.2)),
    ((0, 0), (0.03, 0), (-1, 0)), ((0, 0), (1, 0), (0.97, 0)),
], ids=["right angle", "sharp corner", "as wide as the robot", "at its beginning", "at its end"])
def test_other_paths_are_of_one_leg(corners):
    tracker = tracker_on(line(*corners))
    whole = tracker.cut(state(0.1, 0.0), 9.0, 9.0, 0.0)
    assert tracker.is_on_last_leg and whole.goal[:2] == pytest.approx(corners[-1])


def test_a_path_that_comes_back_to_where_it_began_is_begun_there():
    tracker = tracker_on(line((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)))
    here = state(0.01, 0.05)  # nearer to its end
    assert tracker.cut(here, 0.3, 1.0, 0.5).robot_arc < 0.1 and tracker.remaining(here) > 3.7
    for place in ((1.0, 0.3), (0.5, 1.0), (0.01, 0.05)):
        there = tracker.cut(state(*place), 0.3, 1.0, 0.5)
    assert there.remaining < 0.1 and tracker.remaining(here) < 0.1


def test_a_robot_set_down_elsewhere_is_found_again():
    tracker = tracker_on(line((0, 0), (5, 0)))
    tracker.cut(state(0.1, 0.0), 0.1, 0.1, 0.1)
    assert tracker.cut(state(4.0, 0.3), 0.1, 0.1, 0.1).robot_arc == pytest.approx(4.0)


def test_the_steps_of_a_grid_are_smoothed_and_the_ends_stay():
    stairs = [(0.05 * ((i + 1) // 2), 0.05 * (i // 2)) for i in range(41)]
    path = tracker_on(stairs).cut(state(0.5, 0.5), 9.0, 9.0, 0.0)
    inner = path.points[(path.arcs > 0.1) & (path.arcs < path.goal_arc - 0.1)]
    assert np.abs(inner[:, 0] - inner[:, 1]).max() < 0.036, "the diagonal, a cell's step off at most"
    headings = np.arctan2(*np.diff(inner, axis=0).T[::-1])
    assert np.abs(headings - math.pi / 4).max() < 0.5
    assert path.points[0] == pytest.approx([0.0, 0.0]) and path.point_at(path.goal_arc) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    "points", [[(0.3, 0.1)], [(0.3, 0.1)] * 3, [(0.3, 0.1), (0.305, 0.1)], [(0.0, 0.0), (0.03, 0.0), (0.0, 0.0)]]
)
def test_the_shortest_of_paths_can_be_cut(points):
    path = tracker_on(points).cut(state(0.2, 0.1), 0.5, 0.5, 0.3)
    assert len(path.points) >= 2 and np.isfinite(path.points).all() and (np.diff(path.arcs) >= 0.0).all()
    assert (path.goal.x, path.goal.y) == points[-1]


@pytest.mark.parametrize("poses, word", [
    (np.zeros((0, 3)), "empty"), (np.array([[0.0, 0.0, 0.0], [math.nan, 0.0, 0.0]]), "pose 1"),
    (np.array([[0.0, math.inf, 0.0]]), "pose 0"), (np.zeros(3), "empty"),
    (np.array([[0.0, 0.0, 0.0], [1e308, 0.0, 0.0]]), "pose 1.* within 10000 km"),
    (np.array([[-1e9, 0.0, 0.0]]), "pose 0.* within 10000 km"),
    (np.array([[-9e4, 0.0, 0.0], [9e4, 0.0, 0.0]]), "180 km long; at most 100 km"),
])
def test_what_is_no_path_is_refused_by_name(poses, word):
    with pytest.raises(ControlError, match=word) as refused:
        PathTracker().set_path(Path(poses, "odom"))
    assert refused.value.outcome is ControlOutcome.INVALID_PATH


def test_projection_finds_the_nearest_point_of_the_line():
    rng = np.random.default_rng(2)
    corners = np.cumsum(rng.normal(0, 0.1, (30, 2)), axis=0)
    arcs = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    points = rng.uniform(-1, 1, (50, 2))
    result = np.empty((50, 2))
    path_kernels.project(points, corners, arcs, result)
    dense = np.arange(0.0, arcs[-1], 1e-4)
    places = np.column_stack([np.interp(dense, arcs, corners[:, axis]) for axis in (0, 1)])
    for (x, y), (distance, arc) in zip(points, result):
        gaps = np.hypot(places[:, 0] - x, places[:, 1] - y)
        assert distance == pytest.approx(gaps.min(), abs=1e-4)
        at = [np.interp(arc, arcs, corners[:, axis]) for axis in (0, 1)]
        assert np.hypot(at[0] - x, at[1] - y) == pytest.approx(distance, abs=1e-9)


def nearest_reference(points, line, arcs):
    """Look at every piece of the line; the first of equals counts."""
    ways = np.diff(line, axis=0)
    lengths = (ways ** 2).sum(axis=1)
    inverse = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
    result = []
    for x, y in points:
        px, py = x - line[:-1, 0], y - line[:-1, 1]
        along = np.clip((px * ways[:, 0] + py * ways[:, 1]) * inverse, 0.0, 1.0)
        gaps = (px - along * ways[:, 0]) ** 2 + (py - along * ways[:, 1]) ** 2
        best = int(np.argmin(gaps))
        result.append((math.sqrt(gaps[best]), arcs[best] + along[best] * (arcs[best + 1] - arcs[best])))
    return np.array(result)


@pytest.mark.parametrize("seed", range(20))
def test_what_projection_passes_over_would_not_have_been_nearest(seed):
    """Also on lines that come back on themselves, repeat their points, or end in one long piece."""
    rng = np.random.default_rng(seed)
    headings = np.cumsum(rng.normal(0.0, rng.choice((0.1, 1.0)), int(rng.integers(2, 120))))
    corners = np.cumsum(np.column_stack((np.cos(headings), np.sin(headings))) * 0.02, axis=0)
    corners = (corners, np.vstack((corners, corners[::-1])), np.repeat(corners, 2, axis=0),
               np.vstack((corners, corners[-1] + (5.0, 0.0))))[seed % 4]
    arcs = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    points = np.vstack((rng.normal(0.0, 1.0, (40, 2)), corners[rng.integers(0, len(corners), 20)]))
    result = np.empty((60, 2))
    path_kernels.project(points, corners, arcs, result)
    assert np.array_equal(result, nearest_reference(points, corners, arcs))


@pytest.mark.parametrize("obstacles, blocked", [([], None), ([(50, 30)], 1.0), ([(50, 40)], None)])
def test_a_robot_whose_path_leads_out_of_its_costmap_is_not_told_of_an_obstacle_at_the_edge(obstacles, blocked):
    """Whatever kept it from driving, the log said that an obstacle stood on the path 2 m ahead, which nobody found."""
    costs = np.zeros(COSTMAP.grid.shape, dtype=np.uint8)
    for column, row in obstacles:
        costs[row, column] = 254
    costmap = dataclasses.replace(COSTMAP, costs=costs)
    path = tracker_on(line((0, 0), (3, 0))).cut(state(0.0, 0.0), 0.3, 3.0, 0.1)
    found = path.first_blocked(FootprintChecker(costmap))
    assert found == (None if blocked is None else pytest.approx(blocked, abs=0.05))


def test_a_finer_grid_that_shows_a_fold_behind_the_robot_does_not_lead_the_search_off_the_path(monkeypatch):
    """On a coarse grid it passed a fold unseen; on a finer one its place was looked for beyond the end of a leg."""
    lengths, project = [], path_kernels.project
    monkeypatch.setattr(path_kernels, "project", lambda places, line, arcs, result: (
        lengths.append(len(line)), project(places, line, arcs, result)))
    robot, tracker, legs = Pose2D(0.945, 1.5, 1.5), PathTracker(), []
    tracker.set_path(path_through((0, 0), (1.085, 0.0), (0.945, 0.02), (0.945, 2.0)))
    for resolution in (0.25, 0.02):
        costmap = costmap_round(robot, resolution=resolution)
        path = tracker.cut(dataclasses.replace(state(*robot), costmap=costmap), 0.6, 1.0, 0.4)
        legs.append(len(tracker._legs))
    assert legs == [1, 2] and min(lengths) >= 2
    assert path.robot_distance < 0.01 and path.remaining == pytest.approx(0.5, abs=0.05)
