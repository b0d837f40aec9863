"""The compiled loops over paths and velocities against the same with whole arrays, to the last bit."""

import numpy as np
import pytest

from mbf_relay.control import path_kernels
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.trajectories import STANDING, VelocityWindow, too_slow
from mbf_relay.geometry import STOP, Twist2D, normalize_angles

SEEDS = pytest.mark.parametrize("seed", range(30))


def random_line(rng):
    points = np.cumsum(rng.normal(0.0, 0.05, (rng.integers(1, 60), 2)), axis=0)
    arcs = np.empty(len(points))
    path_kernels.measure(points, arcs)
    return points, arcs


def plain_smooth(points, arcs, spacing, reach):
    count = int(arcs[-1] / spacing)
    if count < 4:
        return None
    places = np.linspace(0.0, arcs[-1], count + 1)
    line = np.column_stack([np.interp(places, arcs, points[:, axis]) for axis in (0, 1)])
    before = 2.0 * line[0] - line[reach:0:-1]
    after = 2.0 * line[-1] - line[-2 : -2 - reach : -1]
    sums = np.cumsum(np.vstack((np.zeros((1, 2)), before, line, after)), axis=0)
    width = 2 * reach + 1
    return (sums[width:] - sums[:-width]) / width


@SEEDS
def test_a_path_is_smoothed_as_with_whole_arrays(seed):
    rng = np.random.default_rng(seed)
    points, arcs = random_line(rng)
    if seed % 3 == 0 and len(points) > 4:
        points[3] = points[2]  # a point twice
        path_kernels.measure(points, arcs)
    assert (arcs == np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))).all()
    spacing, reach = rng.uniform(0.01, 0.05), int(rng.integers(1, 4))
    result = np.empty((int(arcs[-1] / spacing) + 1, 2))
    count = path_kernels.smooth(points, arcs, spacing, reach, result)
    expected = plain_smooth(points, arcs, spacing, reach)
    assert count == 0 if expected is None else (result[:count] == expected).all()


@SEEDS
def test_a_point_of_a_path_is_the_one_numpy_finds(seed):
    rng = np.random.default_rng(seed)
    points, arcs = random_line(rng)
    for place in (*rng.uniform(-0.1, arcs[-1] + 0.1, 20), *arcs):
        found = [path_kernels.interpolate(place, arcs, points, axis) for axis in (0, 1)]
        assert found == [np.interp(place, arcs, points[:, axis]) for axis in (0, 1)]


@SEEDS
def test_the_first_pose_near_another_is_the_one_that_whole_arrays_find(seed):
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-0.1, -0.1, -4.0, 0.0], [0.1, 0.1, 4.0, 1.0], (rng.integers(0, 60), 4))
    x, y, theta = rng.uniform([-0.1, -0.1, -4.0], [0.1, 0.1, 4.0])
    near = np.hypot(poses[:, 0] - x, poses[:, 1] - y) < 0.05
    near &= np.abs(normalize_angles(poses[:, 2] - theta)) < 0.5
    expected = int(np.argmax(near)) if near.any() else -1
    assert path_kernels.first_near(poses, x, y, theta, 0.05, 0.5) == expected


@SEEDS
def test_ways_to_and_from_a_point_are_compared_as_with_whole_arrays(seed):
    rng = np.random.default_rng(seed)
    points, arcs = random_line(rng)
    if seed % 3 == 0 and len(points) > 4:
        points[3] = points[2]  # a point twice
        path_kernels.measure(points, arcs)
    leg = float(rng.choice((arcs[len(arcs) // 3], rng.uniform(0.0, 0.6 * arcs[-1]))))
    inner, products = np.empty(len(points), np.int64), np.empty(len(points))
    count = path_kernels.compare_legs(points, arcs, leg, inner, products)
    between = np.flatnonzero((arcs >= leg) & (arcs <= arcs[-1] - leg))
    before, after = (
        np.column_stack([np.interp(arcs[between] + way, arcs, points[:, axis]) for axis in (0, 1)])
        for way in (-leg, leg))
    assert (inner[:count] == between).all() and count == len(between)
    assert (products[:count] == ((points[between] - before) * (after - points[between])).sum(axis=1)).all()


def test_what_lies_ahead_of_poses_is_in_their_direction():
    poses = np.random.default_rng(1).normal(0.0, 2.0, (50, 3))
    points = np.empty((50, 2))
    path_kernels.look_ahead(poses, 0.3, points)
    ahead = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    assert points == pytest.approx(poses[:, :2] + 0.3 * ahead, abs=1e-15)
    path_kernels.look_ahead(poses, 0.0, points)
    assert (points == poses[:, :2]).all()


@SEEDS
def test_velocities_creep_that_are_slow_and_hardly_turn(seed):
    rng = np.random.default_rng(seed)
    p = DwaParameters(
        min_vel_x=-0.05, max_vel_x=0.3, min_vel_y=-0.1, max_vel_y=0.1, max_vel_trans=0.3, min_vel_trans=0.12,
        min_vel_theta=0.3)
    velocities = rng.choice([-1.0, 0.0, 0.3, 1.0], (200, 3)) * rng.uniform(0.0, (0.3, 0.15, 0.6), (200, 3))
    window = VelocityWindow(Twist2D(-0.05, 0.0, -1.0), Twist2D(rng.uniform(0.02, 0.3), 0.0, 1.0), STOP)
    fastest = np.minimum(
        max(0.05, window.high.x),
        np.maximum(np.where(velocities[:, 0] < 0.0, 0.05, 0.3), np.where(velocities[:, 1] < 0.0, 0.1, 0.1)))
    speeds, turns = np.hypot(velocities[:, 0], velocities[:, 1]), np.abs(velocities[:, 2])
    slow = (speeds > STANDING * p.max_vel_trans) & (speeds < np.minimum(p.min_vel_trans, fastest) - 1e-4)
    assert (too_slow(p, window, velocities) == (slow & (turns < p.min_vel_theta - 1e-4))).all()
