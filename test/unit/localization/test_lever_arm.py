import math

import numpy as np
import pytest
from synthetic_room import scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.gaussians import PoseGaussian
from mbf_relay.localization.lever_arm import CHANGES, USUAL, LeverArm, spread
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import OccupancyMap

START_COVARIANCE = np.diag([0.1, 0.1, 0.05]) ** 2


def long_corridor():
    """Return a hall of 4 m with a corridor of 20 m without anything: what is along it is told in the hall alone."""
    data = np.full((100, 520), 100, dtype=np.int8)
    data[10:90, 10:90] = 0
    data[30:50, 40:44] = 100
    data[38:70, 90:510] = 0
    return OccupancyMap(data, 0.05, Pose2D(0.0, 0.0, 0.0))


def turns_and_steps():
    """Yield a robot's steps: round about in the hall, into the corridor, about on the spot in it and some way back."""
    yield from [Pose2D(0.1, 0.0, -0.2)] * 64
    yield from [Pose2D(0.2, 0.0, 0.0)] * 50
    yield from [Pose2D(0.0, 0.0, math.pi / 8.0)] * 8
    yield from [Pose2D(0.2, 0.0, 0.0)] * 10


@pytest.mark.parametrize("aside", [(0.2, 0.0), (0.0, -0.2), (0.0, 0.0)])
def test_a_robot_whose_lidar_is_not_where_it_is_said_to_be_turns_about_in_a_corridor_and_is_where_it_is_told(aside):
    """Known to be at the base's origin, it is 0.2 m aside; the turn takes it 0.4 m that odometry knows nothing of."""
    occupancy, rng, lidar = long_corridor(), np.random.default_rng(4), Pose2D(*aside, 0.0)
    base, odom, worst = Pose2D(3.0, 3.2, 0.0), IDENTITY, 0.0
    parameters = LocalizerParameters(min_particles=500, max_particles=2000)
    made = Localizer(parameters, occupancy, np.random.default_rng(5))
    made.set_initial_pose(base.compose(lidar), START_COVARIANCE)
    for step in turns_and_steps():
        base, odom = base.compose(step), odom.compose(step)
        made.process(odom, scan_at(occupancy, base.compose(lidar), rng, range_max=3.5), IDENTITY)
        worst = max(worst, made.map_from_odom.compose(odom).distance_to(base.compose(lidar)))
    assert worst < 0.25, made._tracker.lever_arm.arm
    assert made._tracker.lever_arm.arm == pytest.approx(aside, abs=0.06)


@pytest.mark.parametrize("arm", [(0.2, -0.1), (0.0, 0.0)])
@pytest.mark.parametrize("step", [Pose2D(0.3, 0.0, 0.4), Pose2D(0.0, 0.0, -3.0), Pose2D(-0.2, 0.1, 0.0), IDENTITY])
def test_a_step_of_the_base_is_one_of_odometry_seen_from_the_end_of_the_arm(arm, step):
    follower = LeverArm()
    follower.arm = np.array(arm)
    shifted = Pose2D(*arm, 0.0)
    assert follower.moved(step) == pytest.approx(shifted.inverse().compose(step).compose(shifted), abs=1e-12)


def test_arm_and_pose_are_what_a_kalman_filter_of_both_has():
    rng, follower, joint = np.random.default_rng(2), LeverArm(), np.zeros((5, 5))
    joint[:3, :3], joint[3:, 3:] = np.diag([0.1, 0.1, 0.05]) ** 2, np.eye(2) * USUAL ** 2
    pose, arm = np.array([1.0, 2.0, 0.3]), np.zeros(2)
    for _ in range(30):
        step = Pose2D(0.2, 0.0, float(rng.uniform(-0.6, 0.6)))

        def after(state, step=step):
            swung = Pose2D(*state[3:], 0.0).inverse().compose(step).compose(Pose2D(*state[3:], 0.0))
            return np.concatenate((Pose2D(*state[:3]).compose(swung), state[3:]))

        state = np.concatenate((pose, arm))
        jacobian = np.column_stack([(after(state + 1e-6 * axis) - after(state - 1e-6 * axis)) / 2e-6
                                    for axis in np.eye(5)])
        noise, changed = np.diag([0.02, 0.01, 0.02, 0.0, 0.0]) ** 2, np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
        before = joint[:3, :3].copy()
        joint = jacobian @ (joint + changed * CHANGES ** 2 * abs(step.theta)) @ jacobian.T + noise
        moved = follower.moved(step)
        added = follower.predict(float(pose[2]), moved)
        pose = np.array(Pose2D(*pose).compose(moved))
        along = np.eye(3)
        along[:2, 2] = jacobian[:2, 2]
        own = along @ before @ along.T + noise[:3, :3]
        own[:2, :2] += added
        assert own[:2, :2] == pytest.approx(joint[:2, :2], abs=1e-9)
        # A scan that tells across better than along, and turns.
        seen, of_seen = joint[:3, :3], np.diag([0.3, 0.02, 0.01]) ** 2
        gain = joint[:, :3] @ np.linalg.inv(seen + of_seen)
        innovation = rng.multivariate_normal(np.zeros(3), seen + of_seen)
        prior = PoseGaussian(pose.copy(), joint[:3, :3].copy())
        state = np.concatenate((pose, arm)) + gain @ innovation
        joint = joint - gain @ joint[:3, :]
        pose, arm = state[:3], state[3:]
        follower.correct(prior, PoseGaussian(pose.copy(), joint[:3, :3].copy()))
        assert follower.arm == pytest.approx(arm, abs=1e-6)
        assert follower.covariance == pytest.approx(joint[3:, 3:], abs=1e-8)


def test_particles_that_hold_less_of_the_error_than_was_left_in_them_leave_the_arm_a_covariance():
    follower = LeverArm()
    for _ in range(20):
        follower.predict(0.3, follower.moved(Pose2D(0.0, 0.0, 0.8)))
        narrow = np.diag([0.02, 0.02, 0.01]) ** 2
        follower.correct(PoseGaussian(np.zeros(3), narrow), PoseGaussian(np.full(3, 0.01), 0.1 * narrow))
        assert np.linalg.eigvalsh(follower.covariance).min() > 0.0
        assert np.abs(follower.arm).max() < 3.0 * USUAL


@pytest.mark.parametrize("covariance", [
    [[0.04, 0.01], [0.01, 0.02]], [[0.02, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.03]],
])
def test_positions_are_spread_by_what_the_arm_adds(covariance):
    poses = np.tile([1.0, 2.0, 0.5], (40000, 1))
    moved = spread(poses, np.array(covariance), np.random.default_rng(1))
    assert np.cov(moved[:, :2].T) == pytest.approx(np.array(covariance), abs=1e-3)
    assert np.array_equal(moved[:, 2], poses[:, 2])


def test_what_the_arm_takes_away_spreads_nothing():
    poses = np.tile([1.0, 2.0, 0.5], (1000, 1))
    moved = spread(poses, np.array([[-0.04, 0.0], [0.0, 0.02]]), np.random.default_rng(1))
    assert np.array_equal(moved[:, 0], poses[:, 0]) and np.ptp(moved[:, 1]) > 0.0
