"""Wheel speeds and odometry by themselves, without physics."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.simulation.drive import Odometer, approach, limit_command, wheel_speeds
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import DIFFERENTIAL
from mbf_relay.simulation.robot_file import load_robot

WHEELS = load_robot("burger").wheels


def rng():
    return np.random.Generator(np.random.PCG64(4))


def test_wheel_speeds_of_plain_motions():
    assert wheel_speeds(Twist2D(0.33, 0.0, 0.0), WHEELS) == pytest.approx((10.0, 10.0))
    left, right = wheel_speeds(Twist2D(0.0, 0.0, 1.0), WHEELS)
    assert right == -left == pytest.approx(0.08 / 0.033)


def test_commands_are_cut_to_the_limits_and_never_go_sideways():
    limited = limit_command(Twist2D(-3.0, 1.0, 9.0), SimulationParameters(), DIFFERENTIAL)
    assert limited == Twist2D(-0.22, 0.0, 2.84)


@pytest.mark.parametrize(
    "current, target, expected", [(0.0, 1.0, 0.3), (1.0, 0.9, 0.9), (0.0, -1.0, -0.3), (0.5, 0.5, 0.5)]
)
def test_approach_never_overshoots(current, target, expected):
    assert approach(current, target, 0.3) == pytest.approx(expected)


@pytest.mark.parametrize(
    "velocity", [Twist2D(0.2, 0.0, 0.0), Twist2D(0.1, 0.0, 0.7), Twist2D(-0.2, 0.0, 0.4), Twist2D(0.0, 0.0, 2.0)]
)
def test_odometry_adds_up_arcs(velocity):
    odometer = Odometer(WHEELS, 0.0, (0.0, 0.0), rng())
    left, right = (speed / 30.0 for speed in wheel_speeds(velocity, WHEELS))
    for _ in range(90):
        odometer.advance((left, right), 1.0 / 30.0)
    angle = 3.0 * velocity.theta
    if velocity.theta:
        radius = velocity.x / velocity.theta
        expected = Pose2D(radius * math.sin(angle), radius * (1.0 - math.cos(angle)), angle)
    else:
        expected = Pose2D(3.0 * velocity.x, 0.0, 0.0)
    assert odometer.pose.distance_to(expected) < 1e-3
    assert odometer.velocity.x == pytest.approx(velocity.x) and odometer.velocity.theta == pytest.approx(velocity.theta)


def test_the_covariance_says_what_the_noise_does():
    ends = []
    generator = rng()
    for _ in range(600):
        odometer = Odometer(WHEELS, 0.003, (0.0, 0.0), generator)
        for step in range(60):
            odometer.advance((1.0, 1.0 + 0.2 * (step > 30)), 0.1)
        ends.append(odometer.pose)
    found, told = np.cov(np.array(ends).T), odometer.reading(0.0).pose_covariance
    scale = np.sqrt(np.outer(np.diag(told), np.diag(told)))
    assert np.abs((found - told) / scale).max() < 0.25


def test_bias_is_a_share_of_the_way():
    odometer = Odometer(WHEELS, 0.0, (0.1, 0.1), rng())
    odometer.advance((10.0, 10.0), 1.0)
    assert odometer.pose.x == pytest.approx(1.1 * 10.0 * WHEELS.radius)
    odometer.restart()
    assert odometer.pose == Pose2D(0.0, 0.0, 0.0) and odometer.reading(1.0).pose_covariance[0, 0] == pytest.approx(1e-6)
