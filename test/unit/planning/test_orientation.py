"""Headings along a path, in each of global_planner's modes."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.planning.orientation import OrientationMode, oriented

CORNER = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0], [2.0, 3.0], [2.0, 4.0]])
START, GOAL = Pose2D(0.0, 0.0, 1.0), Pose2D(2.0, 4.0, -1.0)


def headings(mode, points=CORNER, window=1):
    poses = oriented(points, START, GOAL, mode, window)
    assert (poses[:, :2] == points).all()
    assert poses[-1, 2] == pytest.approx(-1.0)
    return poses[:-1, 2]


def test_forward_heads_along_the_path():
    quarter = math.pi / 2.0
    assert headings(OrientationMode.FORWARD) == pytest.approx([0.0, 0.0, quarter / 2.0] + [quarter] * 3)


def test_a_wider_window_turns_earlier():
    assert headings(OrientationMode.FORWARD, window=2)[1] == pytest.approx(math.atan2(1.0, 2.0))


@pytest.mark.parametrize("mode, turn", [
    (OrientationMode.BACKWARD, math.pi), (OrientationMode.LEFTWARD, -math.pi / 2.0),
    (OrientationMode.RIGHTWARD, math.pi / 2.0)])
def test_sideways_and_backward_are_turned_from_forward(mode, turn):
    difference = headings(mode) - headings(OrientationMode.FORWARD) - turn
    assert np.cos(difference) == pytest.approx(np.ones(6))


def test_interpolation_goes_evenly_from_the_starts_heading_to_the_goals():
    assert headings(OrientationMode.INTERPOLATE) == pytest.approx(np.linspace(1.0, -1.0, 7)[:-1])


def test_the_last_straight_part_is_interpolated():
    found = headings(OrientationMode.FORWARD_THEN_INTERPOLATE)
    assert found[:3] == pytest.approx([0.0, 0.0, math.pi / 4.0])
    assert found[3:] == pytest.approx(np.linspace(math.pi / 2.0, -1.0, 4)[:-1])


def test_no_orientation_is_zero_but_for_the_goal():
    assert (headings(OrientationMode.NONE) == 0.0).all()


@pytest.mark.parametrize("mode", list(OrientationMode))
def test_a_single_pose_is_the_goals(mode):
    assert oriented(np.array([[2.0, 4.0]]), START, GOAL, mode).tolist() == [[2.0, 4.0, pytest.approx(-1.0)]]
