"""A guard through a drive: clocks that stand or are set back, lidars that freeze or are taken away, wheels that lag."""

import dataclasses
import math

import pytest
from guarded import AHEAD, LASER, guard_that_saw, judged, parameters, scan_with

from mbf_relay.control import velocity_guard as guards
from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.geometry import STOP, Twist2D


def test_a_robot_does_not_drive_by_a_scan_that_never_gets_old_while_simulated_time_stands():
    guard = guard_that_saw(scan_with(3.0, 0, 10))
    guard.time_stands = True
    verdict = judged(guard, AHEAD)
    assert verdict.velocity == STOP and verdict.cause == guards.NO_TIME and "stands at 0.00 s" in verdict.text
    assert judged(guard, STOP).cause == guards.STANDING
    guard.time_stands = False
    assert judged(guard, AHEAD).velocity == AHEAD


def test_a_robot_that_drives_on_as_time_is_set_back_does_not_forget_how_far_it_comes_from_then_on():
    """What had passed was dated ahead, and what passed unchanged was not noted anew."""
    guard = guard_that_saw(scan_with(3.0, 0, 10, stamp=100.0))
    assert judged(guard, AHEAD, 100.0).velocity == AHEAD
    guard.take_scan(scan_with(0.27, -50, 50, stamp=1.0), LASER)
    shares = [judged(guard, AHEAD, 1.0 + 0.1 * tick).velocity.x / AHEAD.x for tick in range(6)]
    assert shares[0] == 1.0 and shares[-1] < 1.0


def test_a_robot_is_not_slowed_for_what_it_drove_at_that_time_before_the_clock_was_set_back():
    verdicts = []
    for drove_before in (True, False):
        guard = VelocityGuard(parameters())
        for stamp in (10.0, 20.0) if drove_before else ():
            guard.take_scan(scan_with(3.0, 0, 10, stamp=stamp), LASER)
            assert judged(guard, AHEAD if stamp == 10.0 else STOP, stamp).cause in (guards.PASSING, guards.STANDING)
        for now in (1.0, 15.0):
            guard.take_scan(scan_with(0.24, -50, 50, stamp=now - 0.4), LASER)
            verdict = judged(guard, AHEAD if now > 1.0 else STOP, now)
        verdicts.append(verdict)
    assert verdicts[0] == verdicts[1] and verdicts[0].cause == guards.PASSING


def test_a_frozen_lidar_is_found_out_as_soon_as_late_wheels_must_have_moved():
    guard = guard_that_saw(scan_with(2.0, 0, 90))
    guard.delay.seconds = 0.5
    passed = []
    for tick in range(16):
        guard.take_scan(scan_with(2.0, 0, 90, stamp=0.1 * tick), LASER)
        passed.append(judged(guard, AHEAD, 0.1 * tick).velocity == AHEAD)
    assert all(passed[:8]) and not any(passed[14:])


@pytest.mark.parametrize("rides, goes_on", [(True, False), (False, True)])
def test_a_robot_drives_on_without_a_lidar_on_the_wall_that_falls_silent_and_not_without_its_own(rides, goes_on):
    guard = VelocityGuard(parameters())
    for tick in range(10):
        if tick < 3:
            guard.take_scan(
                dataclasses.replace(scan_with(3.0, 0, 10 + tick, stamp=0.1 * tick), frame="other"), LASER, rides)
        guard.take_scan(scan_with(3.0 - 0.02 * tick, 0, 90, stamp=0.1 * tick), LASER)
        verdict = judged(guard, AHEAD, 0.1 * tick)
    assert (verdict.velocity == AHEAD) is goes_on, verdict


def test_a_guard_learns_from_odometry_that_the_wheels_follow_late():
    guard, asked = VelocityGuard(parameters()), []
    for tick in range(60):
        now = 0.1 * tick
        guard.take_scan(scan_with(3.0, 0, 10 + tick, stamp=now), LASER)
        asked.append(Twist2D(0.2, 0.0, 0.5 * math.sin(2.0 * now)))
        guard.take_command(now, asked[-1], asked[-7] if len(asked) > 6 else STOP)
        assert guard.verdict(now).velocity == asked[-1]
    assert guard.delay.seconds == pytest.approx(0.5, abs=0.06)
