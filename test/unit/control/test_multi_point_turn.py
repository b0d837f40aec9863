"""Turning a car round in several moves."""

import math

import numpy as np
import pytest
from kinematics import boxes, costmap_round, nowhere, path_through

from mbf_relay.control.local_path import PathTracker
from mbf_relay.control.multi_point_turn import _targets, multi_point_turn
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, angle_between

RADIUS = 0.3
ALLEY = boxes((-3.0, 0.45, 3.0, 0.55), (-3.0, -0.55, 3.0, -0.45))


def turned(pose, path, occupied=nowhere, reverses=True):
    """Return the way found, and the checker it was found with."""
    costmap = costmap_round(pose, occupied, size=6.0)
    state, tracker = ControlState(0.0, pose, STOP, costmap, IDENTITY, 0.1), PathTracker()
    tracker.set_path(path)
    checker = FootprintChecker(costmap)
    return multi_point_turn(pose, tracker.cut(state, 1.0, 4.0, 1.0), checker, RADIUS, reverses), checker


def tightest(way):
    """Return the least radius (m) of a way's curves."""
    moves = np.diff(way.poses, axis=0)
    driven, turns = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
    return float((driven[turns > 1e-9] / (2.0 * np.sin(turns[turns > 1e-9] / 2.0))).min(initial=math.inf))


@pytest.mark.parametrize("heading", [math.pi, 2.0, -2.0, 0.5])
@pytest.mark.parametrize("occupied", [nowhere, ALLEY], ids=["in the open", "in an alley"])
def test_it_ends_on_the_path_in_the_direction_that_leads_on(heading, occupied):
    way, checker = turned(Pose2D(0.0, 0.0, heading), path_through((0, 0), (2.5, 0.0)), occupied)
    end = Pose2D(*way.poses[-1])
    assert end.x > 0.0 and abs(end.y) < 0.02 and abs(angle_between(0.0, end.theta)) < 0.05
    assert not checker.touches(way.poses).any() and tightest(way) > RADIUS


def test_at_the_goal_it_ends_in_the_goal_s_heading():
    path = path_through((-1.0, 0.0), (0.0, 0.0), end_heading=2.0)
    way, _checker = turned(Pose2D(0.02, 0.03, 0.0), path)
    end = Pose2D(*way.poses[-1])
    assert end.distance_to(Pose2D(0.0, 0.0, 0.0)) < 0.02 and abs(angle_between(2.0, end.theta)) < 0.05


@pytest.mark.parametrize("radius", [0.2, 0.55, 3.0])
@pytest.mark.parametrize("length", [1.0, 20.0])
def test_a_car_is_turned_nowhere_but_along_its_path_and_to_its_goal(radius, length):
    """The stretch of the path that is known may end before the places that it could be turned to."""
    state, tracker = ControlState(0.0, IDENTITY, STOP, costmap_round(IDENTITY, size=6.0), IDENTITY, 0.1), PathTracker()
    tracker.set_path(path_through((0, 0), (length, length), end_heading=2.0))
    path = tracker.cut(state, 1.0, 4.0, 1.0)
    places = _targets(path, radius)
    headings = [place.theta for arc, place in places if arc < path.goal_arc]
    assert headings == pytest.approx([math.pi / 4.0] * len(headings))
    is_near = path.goal_arc <= 4.0 * radius
    assert [place.theta for arc, place in places if arc >= path.goal_arc] == [2.0] * is_near
    assert all(abs(place.x - place.y) < 1e-6 for _, place in places)


def test_one_that_may_not_go_back_never_does():
    way, _checker = turned(Pose2D(0.0, 0.0, math.pi), path_through((0, 0), (2.5, 0.0)), reverses=False)
    assert not way.goes_back
    assert turned(Pose2D(0.0, 0.0, math.pi), path_through((0, 0), (2.5, 0.0)))[0].goes_back


def test_one_that_is_walled_in_stays():
    walls = boxes((-0.4, 0.2, 0.4, 0.3), (-0.4, -0.3, 0.4, -0.2), (0.2, -0.3, 0.3, 0.3), (-0.4, -0.3, -0.3, 0.3))
    way, _checker = turned(Pose2D(0.0, 0.0, math.pi), path_through((0, 0), (2.5, 0.0)), walls)
    assert way is None


def test_one_that_touches_something_may_leave_it():
    """What it lies in already is not in its way, or it would be shut in for good."""
    corner = boxes((0.0, 0.09, 0.6, 0.14))
    way, checker = turned(Pose2D(0.0, 0.0, 0.0), path_through((0, 0), (-0.3, -0.4), (-2.5, -0.4)), corner)
    assert checker.contacts_at(Pose2D(0.0, 0.0, 0.0)) and way is not None
    assert not checker.touches(way.poses[-1:]).any()


@pytest.mark.parametrize("blocks", [
    [(-0.21, 0.59), (0.41, 0.04), (-0.43, -0.15), (0.27, -0.17), (-0.67, -0.21)],
    [(-0.37, 0.11), (-0.17, 0.32), (0.35, 0.03), (0.24, 0.59), (0.61, -0.31)],
    [(0.07, 0.57), (-0.3, 0.12), (0.24, 0.62), (0.43, -0.07), (0.48, 0.35)],
])
def test_one_that_no_plain_way_turns_makes_room_for_it_first(blocks):
    """Between pillars it stood for twenty seconds, until it was recovered to another place."""
    occupied = boxes(*[(x - 0.08, y - 0.08, x + 0.08, y + 0.08) for x, y in blocks])
    path = path_through((-0.3, 0.0), (0.0, 0.0), end_heading=math.pi)
    way, checker = turned(Pose2D(0.0, 0.0, 0.0), path, occupied)
    end = Pose2D(*way.poses[-1])
    assert end.distance_to(Pose2D(0.0, 0.0, 0.0)) < 0.02 and abs(angle_between(math.pi, end.theta)) < 0.05
    assert not checker.touches(way.poses).any()


def test_one_that_touches_something_makes_room_as_well_where_no_plain_way_turns_it():
    """A mark at its rear corner, which it may leave, was in the way of every first move: it was given up."""
    blocks = [(0.07, 0.57), (-0.3, 0.12), (0.24, 0.62), (0.43, -0.07), (0.48, 0.35)]
    occupied = boxes((-0.11, -0.12, -0.08, -0.07), *[(x - 0.08, y - 0.08, x + 0.08, y + 0.08) for x, y in blocks])
    path = path_through((-0.3, 0.0), (0.0, 0.0), end_heading=math.pi)
    way, checker = turned(Pose2D(0.0, 0.0, 0.0), path, occupied)
    assert checker.contacts_at(Pose2D(0.0, 0.0, 0.0)) and way is not None
    away = np.hypot(*way.poses[:, :2].T) > 0.1
    assert away.any() and not checker.touches(way.poses[away]).any()
