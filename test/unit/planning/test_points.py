"""A path's points: what is compiled against plain NumPy, to the last bit."""

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D, normalize_angles
from mbf_relay.planning import points_kernels
from mbf_relay.planning.any_angle import spaced
from mbf_relay.planning.orientation import TURNED, oriented

START, GOAL = Pose2D(0.0, 0.0, 0.3), Pose2D(1.0, 1.0, -2.0)


def some_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(int(rng.integers(1, 40)), 2)).cumsum(axis=0)
    points[rng.random(len(points)) < 0.1] = points[0]
    return points


def plain_headings(points, window, turned):
    padded = np.concatenate((points[:1].repeat(window, axis=0), points, points[-1:].repeat(window, axis=0)))
    steps_x, steps_y = (padded[2 * window:] - padded[:-2 * window]).T.copy()
    return normalize_angles(np.arctan2(steps_y, steps_x) + turned)


@pytest.mark.parametrize("seed", range(8))
def test_poses_head_along_the_path(seed):
    points = some_points(seed)
    for mode in (mode for mode in TURNED if mode.name != "FORWARD_THEN_INTERPOLATE"):
        for window in (1, 2, 5):
            poses = oriented(points, START, GOAL, mode, window)
            assert (poses[:, :2] == points).all()
            assert (poses[:-1, 2] == plain_headings(points, window, TURNED[mode])[:-1]).all()


def plainly_spaced(points, spacing):
    steps = points[1:] - points[:-1]
    parts = np.maximum(np.ceil(np.hypot(steps[:, 0], steps[:, 1]) / spacing - 1e-9).astype(int), 1)
    along = [np.arange(count)[:, None] / count * step + point for count, step, point in zip(parts, steps, points)]
    return np.vstack(along + [points[-1:]])


@pytest.mark.parametrize("seed", range(8))
def test_points_are_spread_evenly_along_each_line(seed):
    points = some_points(seed)
    for spacing in (0.05, 0.3, 10.0):
        assert np.array_equal(spaced(points, spacing), plainly_spaced(points, spacing))


def test_points_that_repeat_are_told_from_those_near_each_other():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1e-8], [1.0, 0.0]])
    assert points_kernels.are_apart(points, 1e-9) and points_kernels.are_apart(points[:1], 1e-9)
    assert not points_kernels.are_apart(points, 1e-7) and not points_kernels.are_apart(points[[0, 1, 1, 0]], 1e-9)
