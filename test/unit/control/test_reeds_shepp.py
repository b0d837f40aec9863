"""Ways of a car from pose to pose."""

import math

import numpy as np
import pytest

from mbf_relay.control.reeds_shepp import FORMULAS, LEFT, RIGHT, STRAIGHT, Curve, curves
from mbf_relay.geometry import IDENTITY, Pose2D, angle_between

RADIUS = 0.55


def random_pose(rng, farthest):
    return Pose2D(*rng.uniform(-farthest, farthest, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))


def shortest(start, goal, radius=RADIUS):
    return min(way.length for way in curves(start, goal, radius))


def test_every_way_ends_where_it_should_and_curves_no_more_than_the_circle():
    rng = np.random.default_rng(3)
    for _ in range(60):
        start, goal = random_pose(rng, 5.0), random_pose(rng, 5.0)
        for way in curves(start, goal, RADIUS):
            poses = way.poses(start, 0.05)
            assert tuple(poses[0]) == tuple(start)
            assert goal.distance_to(Pose2D(*poses[-1])) < 1e-6
            assert abs(angle_between(goal.theta, poses[-1, 2])) < 1e-6
            moves = np.diff(poses, axis=0)
            chords, turns = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
            assert (chords <= 0.05 + 1e-9).all()
            assert (2.0 * RADIUS * np.sin(turns / 2.0) <= chords + 1e-9).all()
            assert way.length == pytest.approx(np.hypot(*moves[:, :2].T).sum(), rel=1e-3)


@pytest.mark.parametrize("formula", FORMULAS, ids=lambda formula: formula.__name__)
def test_every_formula_leads_to_the_goal_it_is_given(formula):
    rng, found = np.random.default_rng(5), 0
    for _ in range(200):
        goal = random_pose(rng, 6.0)
        for word in formula(*goal):
            end = Curve(word, 1.0).poses(IDENTITY, math.inf)[-1]
            assert goal.distance_to(Pose2D(*end)) < 1e-6 and abs(angle_between(goal.theta, end[2])) < 1e-6
            found += 1
    assert found > 50


def test_no_drive_of_a_car_is_shorter():
    rng = np.random.default_rng(7)
    for _ in range(1500):
        word = [(int(rng.integers(-1, 2)), float(rng.uniform(-2.0, 2.0))) for _ in range(rng.integers(1, 6))]
        drive = Curve(word, RADIUS)
        end = Pose2D(*drive.poses(IDENTITY, math.inf)[-1].tolist())
        assert shortest(IDENTITY, end) <= drive.length + 1e-6, word


def test_it_is_as_far_there_as_back():
    rng = np.random.default_rng(11)
    for _ in range(50):
        start, goal = random_pose(rng, 3.0), random_pose(rng, 3.0)
        assert shortest(start, goal) == pytest.approx(shortest(goal, start))


@pytest.mark.parametrize("goal, length, cusps", [
    (Pose2D(2.0, 0.0, 0.0), 2.0, 0),  # straight on
    (Pose2D(-2.0, 0.0, 0.0), 2.0, 0),  # straight back
    (Pose2D(RADIUS, RADIUS, math.pi / 2.0), RADIUS * math.pi / 2.0, 0),  # round a corner
    (Pose2D(0.0, 0.0, math.pi), RADIUS * math.pi, 2),  # about turn, in three moves
])
def test_known_ways_are_as_long_as_they_are(goal, length, cusps):
    way = min(curves(IDENTITY, goal, RADIUS), key=lambda one: one.length)
    assert (way.length, way.cusps) == (pytest.approx(length), cusps)


def test_one_that_may_not_go_back_has_ways_as_well():
    rng = np.random.default_rng(13)
    for _ in range(50):
        goal = random_pose(rng, 4.0)
        found = [way for way in (one.forwards() for one in curves(IDENTITY, goal, RADIUS)) if way is not None]
        for way in found:
            end = Pose2D(*way.poses(IDENTITY, 0.05)[-1])
            assert goal.distance_to(end) < 1e-6 and abs(angle_between(goal.theta, end.theta)) < 1e-6
            assert way.cusps == 0 and all(length > 0.0 for _, length in way.word)
        assert found


def test_where_it_is_already_there_is_no_way():
    assert [way for way in curves(IDENTITY, IDENTITY, RADIUS) if way.length < 1e-6] == []
    assert Curve([(LEFT, 1.0), (STRAIGHT, -1.0), (RIGHT, 1.0)], RADIUS).forwards() is None
