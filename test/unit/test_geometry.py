"""Poses and angles against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbf_relay.geometry import Pose2D, angle_between, normalize_angle, normalize_angles

coordinates = st.floats(-50.0, 50.0)
angles = st.floats(-10.0, 10.0)
poses = st.builds(Pose2D, coordinates, coordinates, angles)


def matrix(pose):
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    return np.array([[cos, -sin, pose.x], [sin, cos, pose.y], [0.0, 0.0, 1.0]])


@given(poses, poses)
def test_composition_is_the_product_of_matrices(first, second):
    np.testing.assert_allclose(matrix(first.compose(second)), matrix(first) @ matrix(second), atol=1e-9)


@given(poses)
def test_inverse_is_the_inverse_matrix(pose):
    np.testing.assert_allclose(matrix(pose.inverse()), np.linalg.inv(matrix(pose)), atol=1e-9)


@given(poses, poses)
def test_a_relative_pose_leads_back(pose, reference):
    back = reference.compose(pose.relative_to(reference))
    np.testing.assert_allclose(matrix(back), matrix(pose), atol=1e-9)


@given(st.floats(-1000.0, 1000.0))
def test_a_normalized_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = normalize_angle(angle)
    assert -math.pi <= wrapped < math.pi + 1e-12
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-9)
    assert normalize_angles(np.array([angle]))[0] == wrapped


@given(angles, angles)
def test_the_turn_between_two_angles_is_the_shortest(start, end):
    turn = angle_between(start, end)
    assert abs(turn) <= math.pi
    assert math.cos(start + turn - end) == pytest.approx(1.0, abs=1e-9)


@given(poses, st.lists(st.tuples(coordinates, coordinates, angles), min_size=1, max_size=5))
def test_arrays_are_transformed_as_single_poses_are(transform, rows):
    array = np.array(rows)
    expected = [transform.compose(Pose2D(*row)) for row in rows]
    transformed = transform.transform_poses(array)
    np.testing.assert_allclose(transformed[:, :2], [pose[:2] for pose in expected], atol=1e-9)
    np.testing.assert_allclose(np.cos(transformed[:, 2] - [pose.theta for pose in expected]), 1.0, atol=1e-9)
    np.testing.assert_allclose(transform.transform_points(array[:, :2]), transformed[:, :2], atol=1e-9)


@pytest.mark.parametrize("pose", [Pose2D(math.nan, 0, 0), Pose2D(0, math.inf, 0), Pose2D(0, 0, math.nan)])
def test_a_pose_that_is_not_finite_says_so(pose):
    assert not pose.is_finite()
