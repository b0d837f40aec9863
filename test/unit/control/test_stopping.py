"""Where a differential drive stands once its wheels are told to stand, and that whoever lets it drive knows."""

import math

import numpy as np
import pytest

from mbf_relay.control.stopping import seconds_to_brake, way_to_a_stand
from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.outline import clearances
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.scan import LaserScan

TRACK, RIM = 0.16, 1.0  # of the burger: metres, and m/s^2


def wheels_stop(velocity, pose=Pose2D(0.0, 0.0, 0.0), held=0.0, step=1e-3, rim=RIM):
    """Return the poses of a robot that holds a velocity for a while and whose wheels then stop, in small steps."""
    wheels = np.array([velocity.x - velocity.theta * TRACK / 2.0, velocity.x + velocity.theta * TRACK / 2.0])
    poses = [pose]
    for index in range(int(round(held / step)) + int(np.abs(wheels).max() / rim / step) + 2):
        ahead, turn = wheels.mean() * step, (wheels[1] - wheels[0]) / TRACK * step
        half = poses[-1].compose(Pose2D(0.0, 0.0, turn / 2.0))
        poses.append(half.compose(Pose2D(ahead, 0.0, turn / 2.0)))
        if index >= int(round(held / step)):
            wheels = np.sign(wheels) * np.maximum(0.0, np.abs(wheels) - rim * step)
    return poses


VELOCITIES = [
    Twist2D(0.8, 0.0, 1.5), Twist2D(0.8, 0.0, 0.0), Twist2D(0.22, 0.0, -2.75), Twist2D(0.0, 0.0, 2.0),
    Twist2D(-0.2, 0.0, 1.0), Twist2D(0.1, 0.0, 2.5), Twist2D(-0.8, 0.0, -1.5), Twist2D(0.0, 0.0, -2.0),
]


@pytest.mark.parametrize("rim", [RIM, 0.7])
@pytest.mark.parametrize("velocity", VELOCITIES)
def test_the_way_to_a_stand_is_that_of_two_wheels_that_brake(velocity, rim):
    start = Pose2D(1.0, -2.0, 0.5)
    poses = way_to_a_stand(start, velocity, TRACK, rim, 0.01, 0.05)
    stepped = np.array(wheels_stop(velocity, start, rim=rim))
    assert poses[-1] == pytest.approx(stepped[-1], abs=2e-3)
    for pose in poses:
        assert np.abs(stepped - pose).max(axis=1).min() < 5e-3, "on the way"
    steps = np.abs(np.diff(np.vstack((start, poses)), axis=0))
    assert np.hypot(steps[:, 0], steps[:, 1]).max() <= 0.016 and steps[:, 2].max() <= 0.08
    assert seconds_to_brake(velocity, rim, 3.2, TRACK) == pytest.approx(1e-3 * len(stepped), abs=4e-3)


@pytest.mark.parametrize("velocity, seconds", [
    (Twist2D(0.8, 0.0, 0.6), 2.0), (Twist2D(-0.3, 0.4, 0.0), 1.25), (Twist2D(0.1, 0.0, -4.5), 3.0)])
def test_what_brakes_speed_and_turn_each_by_itself_stands_when_both_do(velocity, seconds):
    assert seconds_to_brake(velocity, 0.4, 1.5, 0.0) == pytest.approx(seconds)


def test_a_standing_robot_has_no_way_to_a_stand():
    assert way_to_a_stand(Pose2D(1.0, 2.0, 3.0), Twist2D(0.0, 0.0, 0.0), TRACK, RIM, 0.01, 0.05).shape == (0, 3)


@pytest.mark.parametrize("velocity", [Twist2D(0.5, 0.0, 1.5), Twist2D(0.22, 0.0, 2.75), Twist2D(0.0, 0.0, -2.0)])
def test_the_simulated_burger_told_to_stand_stands_where_it_is_reckoned_to(velocity):
    pytest.importorskip("pybullet")
    from mbf_relay.simulation import Simulation, arena
    from mbf_relay.simulation.parameters import SimulationParameters

    simulation = Simulation(arena.arena(), SimulationParameters(max_speed=0.8), 1)
    try:
        for _ in range(100):
            simulation.set_command(velocity)
            simulation.step()
        before = simulation.true_pose
        simulation.set_command(Twist2D(0.0, 0.0, 0.0))
        for _ in range(100):
            simulation.step()
        stood = simulation.true_pose.relative_to(before)
    finally:
        simulation.close()
    reckoned = way_to_a_stand(Pose2D(0.0, 0.0, 0.0), velocity, TRACK, RIM, 0.01, 0.05)[-1]
    assert stood == pytest.approx(reckoned, abs=0.06)
    assert math.hypot(*(np.array(stood[:2]) - reckoned[:2])) < 0.01


def burger_guard(scan):
    guard = VelocityGuard(VelocityGuardParameters(
        footprint=[[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]], base_frame="base_footprint",
        acc_lim_x=RIM, wheel_separation=TRACK))
    guard.take_scan(scan, Pose2D(-0.032, 0.0, 0.0))
    return guard


@pytest.mark.parametrize("seed", range(6))
def test_a_fast_robot_in_a_curve_that_the_guard_lets_pass_stands_before_what_the_lidar_shows(seed):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.25, 1.5, 360)
    ranges[rng.random(360) < 0.8] = np.inf
    guard = burger_guard(LaserScan(ranges, 0.0, 2.0 * math.pi / 360, 0.12, 3.5, 0.0))
    points, outline = guard._sights[0].points, guard._parameters.outline()
    for _ in range(8):
        velocity = Twist2D(float(rng.uniform(0.3, 0.8)), 0.0, float(rng.uniform(-2.5, 2.5)))
        guard.take_command(0.0, velocity)
        passed = guard.verdict(0.0).velocity
        for pose in wheels_stop(passed, held=guard._parameters.reaction_time, step=1e-2):
            assert clearances(pose.inverse().transform_points(points), outline).min() > 0.0, (velocity, passed)
