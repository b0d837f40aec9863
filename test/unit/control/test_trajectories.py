"""The dynamic window, its samples, and forward simulation, against plain references."""

import dataclasses
import math

import numpy as np
import pytest
from paper import burger, random_scene
from plain_footprint import random_costmap

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.trajectories import (
    VelocityWindow,
    roll_out,
    sample,
    speed_to_stop_within,
    too_slow,
    window_of,
)
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.grid import Grid


def test_the_window_is_what_acceleration_reaches_within_the_limits():
    window = window_of(burger(), Twist2D(0.1, 0.0, 2.6), 0.1, 0.22, 2.75)
    assert window.high == pytest.approx((0.22, 0.0, 2.75))
    assert window.low == pytest.approx((-0.15, 0.0, 2.28))


def test_a_robot_beyond_its_limit_brakes_as_hard_as_it_can():
    window = window_of(burger(), Twist2D(0.22, 0.0, 2.0), 0.02, 0.1, 1.0)
    assert window.high.x == window.low.x == pytest.approx(0.22 - 2.5 * 0.02)
    assert window.high.theta == window.low.theta == pytest.approx(2.0 - 3.2 * 0.02)


def test_samples_are_even_and_hold_the_ends_and_zero():
    parameters = burger(vx_samples=4, vth_samples=6)
    velocities = sample(parameters, window_of(parameters, STOP, 0.05, 0.22, 2.75), 0.22)
    assert sorted(set(np.round(velocities[:, 0], 6))) == pytest.approx([-0.125, -0.041667, 0.0, 0.041667, 0.125])
    assert sorted(set(np.round(velocities[:, 2], 6))) == pytest.approx([-0.16, -0.096, -0.032, 0.0, 0.032, 0.096, 0.16])
    assert not (np.abs(velocities).sum(axis=1) == 0.0).any(), "standing still is no trajectory"


def test_no_sample_is_faster_than_the_top_speed_in_all():
    parameters = burger(max_vel_y=0.2, min_vel_y=-0.2, vy_samples=5, acc_lim_y=2.5)
    velocities = sample(parameters, window_of(parameters, Twist2D(0.1, 0.1, 0.0), 0.1, 0.22, 2.75), 0.22)
    assert np.hypot(velocities[:, 0], velocities[:, 1]).max() <= 0.22 + 1e-3
    assert (velocities[:, 1] < 0.0).any() and (velocities[:, 1] > 0.0).any()


@pytest.mark.parametrize("counts", [(0, 0, 0), (1, 1, 1), (2, 0, 3)])
def test_few_or_no_samples_asked_for_still_give_the_ends_of_the_window(counts):
    parameters = burger(**dict(zip(("vx_samples", "vy_samples", "vth_samples"), counts)))
    window = window_of(parameters, STOP, 0.1, 0.22, 2.75)
    velocities = sample(parameters, window, 0.22)
    assert velocities[:, 0].max() == pytest.approx(window.high.x) and velocities[:, 2].min() == pytest.approx(
        window.low.theta
    )


def test_creeping_is_told_from_starting_and_from_turning():
    parameters = burger()
    window = window_of(parameters, Twist2D(0.2, 0.0, 0.0), 0.1, 0.22, 2.75)
    candidates = np.array([[0.05, 0.0, 0.1], [0.05, 0.0, 1.5], [0.0, 0.0, 0.2], [0.12, 0.0, 0.0]])
    assert too_slow(parameters, window, candidates).tolist() == [True, False, False, False]
    starting = window_of(parameters, STOP, 0.02, 0.22, 2.75)
    assert not too_slow(parameters, starting, np.array([[starting.high.x, 0.0, 0.0]])).any()


def axis_reference(low, high, count):
    if high - low < 1e-9:
        return np.array([high])
    values = np.linspace(low, high, max(2, count))
    if low < 0.0 < high and not (np.abs(values) < 1e-12).any():
        values = np.sort(np.append(values, 0.0))
    return values


def sample_reference(parameters, window, speed):
    """Every combination of evenly spaced values, without those that stand or are too fast."""
    counts = (parameters.vx_samples, parameters.vy_samples, parameters.vth_samples)
    axes = [axis_reference(*limits) for limits in zip(window.low, window.high, counts)]
    velocities = np.column_stack([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
    speeds = np.hypot(velocities[:, 0], velocities[:, 1])
    slowest = np.hypot(*(min(abs(low), abs(high)) if low * high > 0.0 else 0.0
                         for low, high in zip(window.low[:2], window.high[:2])))
    stands = (speeds < 1e-6) & (np.abs(velocities[:, 2]) < 1e-6)
    return velocities[~stands & (speeds <= max(speed, slowest) + 1e-4)]


@pytest.mark.parametrize("seed", range(30))
def test_samples_are_what_plain_numpy_makes_of_the_window(seed):
    rng = np.random.default_rng(seed)
    counts = dict(zip(("vx_samples", "vy_samples", "vth_samples"), map(int, rng.integers(0, (21, 5, 41)))))
    sideways = dict(min_vel_y=-0.1, max_vel_y=0.1, acc_lim_y=1.0) if seed % 2 else {}
    parameters = burger(**counts, **sideways)
    now = Twist2D(*rng.uniform((-0.22, -0.1, -2.7), (0.22, 0.1, 2.7)))
    window = window_of(parameters, now, 0.1, float(rng.choice((0.1, 0.22))), 2.75)
    assert np.array_equal(sample(parameters, window, 0.15), sample_reference(parameters, window, 0.15))


def integrated(pose, start, target, accelerations, duration, count, substeps=400):
    """Euler in very small steps, velocity constant within each of `count` steps."""
    step, velocity, poses = duration / count, np.array(start, float), []
    x, y, theta = pose
    for _ in range(count):
        velocity = velocity + np.clip(np.array(target) - velocity, -accelerations * step, accelerations * step)
        for _ in range(substeps):
            dt = step / substeps
            x += (velocity[0] * math.cos(theta) - velocity[1] * math.sin(theta)) * dt
            y += (velocity[0] * math.sin(theta) + velocity[1] * math.cos(theta)) * dt
            theta += velocity[2] * dt
        poses.append((x, y, theta))
    return np.array(poses)


@pytest.mark.parametrize("accelerates", [False, True])
def test_simulation_drives_exact_arcs(accelerates):
    rng = np.random.default_rng(3)
    for _ in range(8):
        pose, now = rng.uniform(-1, 1, 3), rng.uniform((-0.3, -0.2, -2.0), (0.3, 0.2, 2.0))
        target, accelerations = rng.uniform((-0.5, -0.3, -2.5), (0.5, 0.3, 2.5)), np.array([0.5, 0.4, 2.0])
        poses, counts, steps = np.empty((1, 80, 3)), np.empty(1, np.int64), np.empty(1)
        start = now if accelerates else np.full(3, np.nan)
        trajectory_kernels.simulate(
            pose, start, accelerations, target[None], np.array([1.5]), 0.025, 0.1, poses, counts, steps)
        expected_count = math.ceil(max(math.hypot(*target[:2]) * 1.5 / 0.025, abs(target[2]) * 1.5 / 0.1) - 1e-9)
        assert counts[0] == expected_count and steps[0] == pytest.approx(1.5 / expected_count)
        first = now if accelerates else target
        expected = integrated(pose, first, target, accelerations, 1.5, expected_count)
        assert np.allclose(poses[0, : counts[0]], expected, atol=2e-3)


@pytest.mark.parametrize("seed", range(10))
def test_trajectories_last_and_end_as_plain_numpy_says(seed):
    rng = np.random.default_rng(seed)
    parameters = burger()
    batch, data = random_scene(rng, parameters)
    acceleration, left = np.array([2.5, 1e-9, 3.2]), float(rng.choice((0.05, 0.2, 2.0)))
    batch = roll_out(parameters, data.checker, data.pose, data.velocity, batch.velocities, 0.1, left, 0.9)
    speeds = np.hypot(*batch.velocities[:, :2].T)
    stopping = 0.1 + 0.2 + np.max(np.abs(batch.velocities) / (2.0 * acceleration), axis=1)
    durations = np.full(len(batch), max(0.9, stopping.max()))
    moving = speeds > 1e-3
    durations[moving] = np.minimum(durations[moving], np.maximum(left / speeds[moving], stopping[moving]))
    turns = np.abs(batch.velocities[:, 2])
    counts = np.ceil(np.maximum(speeds * durations / 0.025, turns * durations / 0.1) - 1e-9)
    assert np.array_equal(batch.counts, np.maximum(1, counts))
    assert np.array_equal(batch.needed, np.minimum(batch.counts, np.ceil(stopping / (durations / batch.counts) - 1e-9)))
    assert batch.spare == pytest.approx(
        np.where(batch.free == batch.counts, np.maximum(0.0, 0.9 - durations) * speeds, 0.0)
    )
    last = batch.poses[np.arange(len(batch)), np.maximum(batch.free, 1) - 1]
    last[batch.free == 0] = data.pose
    assert np.array_equal(batch.ends, last)


def test_a_fast_robot_has_a_larger_footprint():
    parameters = burger(max_vel_trans=0.5, max_vel_x=0.5, scaling_speed=0.2, max_scaling_factor=0.5)
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap.costs[:] = 0
    costmap.costs[33, 30:50] = 254  # from y = 0.15 on, beside a footprint of 0.105, inside one of 0.158
    checker = FootprintChecker(dataclasses.replace(costmap, obstacle_overlap=0.0))
    velocities = np.array([[0.2, 0.0, 0.0], [0.5, 0.0, 0.0]])
    batch = roll_out(parameters, checker, Pose2D(-0.2, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), velocities, 0.1, 9.0, 1.5)
    assert batch.free[0] == batch.counts[0] and batch.free[1] < batch.counts[1]


@pytest.mark.parametrize("speed", [0.22, 0.8])
def test_no_trajectory_leads_across_a_lone_cell_between_two_of_its_poses(speed):
    """It drove into a box at 0.8 m/s of which few cells were marked yet: its front had stepped across each of them."""
    parameters = burger(max_vel_trans=speed, max_vel_x=speed, acc_lim_x=1.0, max_scaling_factor=0.0)
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap = dataclasses.replace(costmap, grid=Grid(0.025, -0.75, -0.75, 60, 60), costs=np.zeros((60, 60), np.uint8))
    costmap.costs[30, 44] = 254
    checker = FootprintChecker(costmap)
    for start in np.arange(-0.2, -0.15, 0.001):
        pose = Pose2D(start, -0.03, 0.0)
        batch = roll_out(
            parameters, checker, pose, Twist2D(speed, 0.0, 0.0), np.array([[speed, 0.0, 0.0]]), 0.1, 9.0, 3.0)
        assert batch.free[0] < batch.counts[0]
        assert batch.ends[0, 0] == pytest.approx(0.35 - 0.041, abs=0.025)


def test_a_trajectory_stops_at_the_goal_and_says_how_much_farther_it_would_come():
    parameters = burger()
    checker = FootprintChecker(random_costmap(np.random.default_rng(1), obstacles=0))
    velocities = np.array([[0.2, 0.0, 0.0], [0.15, 0.0, 0.0], [0.0, 0.0, 1.0]])
    batch = roll_out(parameters, checker, Pose2D(0.0, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), velocities, 0.1, 0.12, 1.5)
    assert batch.ends[:2, 0] == pytest.approx([0.12, 0.12], abs=1e-6)
    assert batch.spare[:2] == pytest.approx([0.2 * 1.5 - 0.12, 0.15 * 1.5 - 0.12])
    assert batch.ends[2, 2] == pytest.approx(1.5) and batch.spare[2] == 0.0


def test_stopping_and_the_speed_to_stop_are_inverse():
    for speed in (0.05, 0.22, 1.0):
        for delay in (0.0, 0.1, 0.5):
            distance = speed * delay + speed * speed / (2.0 * 2.5)
            assert speed_to_stop_within(distance, 2.5, delay) == pytest.approx(speed)
    assert speed_to_stop_within(0.0, 1.0, 0.1) == speed_to_stop_within(-1.0, 1.0, 0.1) == 0.0


def test_with_acceleration_through_the_whole_horizon_the_command_is_still_within_one_period():
    parameters = burger(use_dwa=False, acc_lim_x=0.2, acc_lim_theta=1.0)
    velocity = Twist2D(0.05, 0.0, 0.0)
    window = window_of(parameters, velocity, parameters.sim_time, 0.22, 2.75)
    velocities = sample(parameters, window, 0.22)
    checker = FootprintChecker(random_costmap(np.random.default_rng(1), obstacles=0))
    batch = roll_out(parameters, checker, Pose2D(0.0, 0.0, 0.0), velocity, velocities, 0.1, 9.0, 1.5)
    assert np.abs(batch.commands - velocity).max(axis=0) == pytest.approx([0.02, 0.0, 0.1])
    assert velocities[:, 2].max() == pytest.approx(1.5), "the samples reach what 1.5 s allow"


def test_equal_scenes_give_equal_batches():
    first, _ = random_scene(np.random.default_rng(11))
    second, _ = random_scene(np.random.default_rng(11))
    assert np.array_equal(first.ends, second.ends) and np.array_equal(first.free, second.free)


def test_a_batch_of_velocities_is_clipped_as_each_is_alone_to_the_sign_of_a_zero():
    rng = np.random.default_rng(3)
    velocities = np.vstack((rng.uniform(-1.0, 1.0, (200, 3)), rng.choice([-0.5, -0.0, 0.0, 0.5], (200, 3))))
    for low, high in (((-0.5, 0.0, -0.5), (0.5, 0.0, 0.5)), ((0.0, -0.0, -0.0), (0.5, 0.0, 0.5))):
        window = VelocityWindow(Twist2D(*low), Twist2D(*high), STOP)
        alone = np.array([window.clip(Twist2D(*row)) for row in velocities.tolist()])
        assert window.clip_all(velocities).tobytes() == alone.tobytes()
