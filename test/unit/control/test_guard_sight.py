"""Which way a guard's lidar looks, wherever its beams begin, and how far a large robot reaches."""

import math

import numpy as np
import pytest
from guarded import guard_that_saw, judged, parameters, scan_of, scan_with

from mbf_relay.control import velocity_guard as guards
from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.geometry import Pose2D, Twist2D


@pytest.mark.parametrize("first", [-90, -30, 60])
@pytest.mark.parametrize("turned", [0, 120])
def test_a_robot_that_goes_sideways_is_slow_where_no_beam_looks_and_there_alone(first, turned):
    half = scan_of(np.full(181, 3.0), angle_min=math.radians(first), increment=math.pi / 180)
    guard = guard_that_saw(half)
    guard.take_scan(half, Pose2D(0.0, 0.0, math.radians(turned)))
    for direction in range(5, 365, 30):
        angle = math.radians(direction)
        verdict = judged(guard, Twist2D(0.22 * math.cos(angle), 0.22 * math.sin(angle), 0.0))
        looks = (direction - turned - first) % 360 <= 180
        assert (verdict.cause, round(verdict.velocity.speed(), 3)) == (
            (guards.PASSING, 0.22) if looks else (guards.UNSEEN, 0.1)), direction


def test_a_lidar_that_looks_all_round_looks_everywhere_however_much_may_go_unseen():
    guard = guard_that_saw(scan_of(np.full(360, 3.0)), blind_sector=7.0)
    assert judged(guard, Twist2D(-0.22, 0.0, 0.0)).cause == guards.PASSING


@pytest.mark.parametrize("velocity, free", [
    (Twist2D(0.0, 0.0, 0.8), 1.45), (Twist2D(0.0, 0.0, -0.8), 1.45), (Twist2D(0.3, 0.0, 0.0), 2.0)])
def test_a_robot_of_three_metres_does_not_swing_its_far_end_into_somebody(velocity, free):
    outline = [[-1.5, -0.4], [-1.5, 0.4], [1.5, 0.4], [1.5, -0.4]]
    sign = 1.0 if velocity.theta >= 0.0 else -1.0
    for x, y, passes in ((1.4, sign * 0.46, velocity.x > 0.0), (1.58, 0.0, velocity.x == 0.0), (free, 1.3, True)):
        somebody = round(math.degrees(math.atan2(y, x)))
        guard = VelocityGuard(parameters(footprint=outline))
        guard.take_scan(scan_with(math.hypot(x, y), somebody, somebody + 1), Pose2D(0.0, 0.0, 0.0))
        assert (judged(guard, velocity).velocity == velocity) is passes, (x, y)
