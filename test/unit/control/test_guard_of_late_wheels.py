"""A guard that knows how late wheels do what they are told, or takes them to be late."""

import math

import numpy as np
import pytest
from guarded import AHEAD, BEAMS, LASER, guard_that_saw, judged, parameters, scan_of, scan_with

from mbf_relay.control import velocity_guard as guards
from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.geometry import STOP, Twist2D


def guard_of_wheels_believed_late(scan, late=1.0, velocity=AHEAD):
    """Return a guard that has let a velocity pass for two seconds, and takes wheels to be late by `late` (s)."""
    guard = VelocityGuard(parameters())
    guard.take_scan(scan_with(3.0, 0, 10, stamp=-2.0), LASER)
    guard.take_command(-2.0, velocity)
    assert guard.verdict(-2.0).velocity == velocity
    guard.delay.seconds = late
    guard.take_scan(scan, LASER)
    return guard


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 1.4])
@pytest.mark.parametrize("distance", [0.122, 0.13, 0.14])
def test_what_a_late_robot_meets_before_it_can_hear_stops_it_and_is_not_taken_for_passed(distance, late):
    pole = scan_with(distance, -3, 4)
    verdict = judged(guard_of_wheels_believed_late(pole, late), AHEAD)
    assert verdict.cause == guards.OBSTACLE and verdict.velocity.x < AHEAD.x
    if late > 0.0:
        assert verdict.velocity == STOP


@pytest.mark.parametrize("late, passes", [(0.0, True), (0.3, True), (0.6, False), (1.2, False)])
def test_a_late_robot_brakes_as_much_sooner_as_it_hears_late(late, passes):
    verdict = judged(guard_of_wheels_believed_late(scan_with(0.27, -3, 4), late), AHEAD)
    assert (verdict.velocity == AHEAD) is passes


def test_a_late_robot_may_turn_away_from_what_it_stands_before():
    guard = guard_of_wheels_believed_late(scan_with(0.11, -3, 4), 0.5, STOP)
    assert judged(guard, Twist2D(-0.2, 0.0, 0.0)).cause == guards.PASSING


@pytest.mark.parametrize("turn", [-1.5, 1.5])
@pytest.mark.parametrize("late", [1.0, 1.4])
def test_a_robot_wrongly_thought_late_does_not_drive_into_the_wall_it_is_thought_to_have_turned_from(late, turn):
    wall, turned, asked = scan_with(0.3, -30, 31), Twist2D(0.0, 0.0, turn), Twist2D(0.6, 0.0, 0.0)
    prompt, late = (judged(guard_of_wheels_believed_late(wall, by, turned), asked) for by in (0.0, late))
    assert prompt.velocity.x < asked.x
    assert late.velocity.x <= prompt.velocity.x and late.cause == guards.OBSTACLE


@pytest.mark.parametrize("speed", [0.22, 5.0])
def test_a_late_robot_goes_no_faster_than_it_can_stop_where_its_lidar_looks(speed):
    asked = Twist2D(speed, 0.0, 0.0)
    guard = guard_that_saw(scan_with(math.inf, 0, 0))
    prompt = judged(guard, asked).velocity.x
    guard.delay.seconds = 1.0
    late = judged(guard, asked).velocity.x
    if speed < 1.0:
        assert late == prompt == speed
    else:
        room = 3.5 - 0.032 - 0.041
        assert late < prompt and late * 1.2 + late * late / 2.0 == pytest.approx(room, rel=0.02)


TICK, WALL, FRONT = 0.01, 0.6, 0.041


def scan_of_wall(x, stamp):
    """Return what a lidar sees of a wall across the way, 0.3 m wide, with the robot at x (m)."""
    distance, angles = WALL - x - LASER.x, 2.0 * math.pi / BEAMS * np.arange(BEAMS)
    faces = (np.cos(angles) > 0.1) & (np.abs(distance * np.tan(angles)) <= 0.15)
    ranges = np.full(BEAMS, np.inf)
    ranges[faces] = distance / np.cos(angles[faces])
    return scan_of(np.where(ranges < 0.12, 0.0, ranges), stamp)


def least_room(speed, scan_age, look, delay, start):
    """Return how near (m) a robot comes to the wall that is asked to drive on into it, a tick after the other.

    It brakes as hard as the guard counts on, and no harder.

    Args:
        speed: What is asked for (m/s), and what it drives at first.
        scan_age: Of a scan when it comes (s); one is taken every 0.2 s.
        look: From one look of the guard to the next (s).
        delay: From a look to when the wheels hear of it (s).
        start: Where it is at first (m).
    """
    guard = VelocityGuard(parameters())
    x, v, told, coming, scans, least = start, speed, speed, [], [], math.inf
    guard.take_scan(scan_of_wall(x, 0.0), LASER)
    for tick in range(400):
        now = TICK * tick
        if tick % 20 == 0:
            scans.append((now + scan_age, scan_of_wall(x, now)))
        while scans and scans[0][0] <= now + 1e-9:
            guard.take_scan(scans.pop(0)[1], LASER)
        if tick % round(look / TICK) == 0:
            coming.append((now + delay, judged(guard, Twist2D(speed, 0.0, 0.0), now).velocity.x))
        while coming and coming[0][0] <= now + 1e-9:
            told = coming.pop(0)[1]
        v = min(told, v + 1.0 * TICK) if told > v else max(told, v - 1.0 * TICK)
        x += v * TICK
        least = min(least, WALL - x - FRONT)
    return least


@pytest.mark.parametrize("look, delay", [(0.2, 0.0), (0.1, 0.1), (0.05, 0.14)])
@pytest.mark.parametrize("speed, start, scan_age", [(0.22, 0.0, 0.0), (0.22, 0.0, 0.4), (1.0, -1.0, 0.2)])
def test_a_robot_touches_nothing_where_looks_and_delay_keep_within_the_reaction_time(
    speed, start, scan_age, look, delay
):
    """With a delay too short to be told, what was under way to the wheels counted as done: they touched, braking."""
    for along in (0.0, 0.013, 0.027):
        room = least_room(speed, scan_age, look, delay, start + along)
        assert 0.0 < room < 0.1, (along, room)


def test_a_wall_that_is_far_yet_near_to_where_late_wheels_bring_the_robot_is_looked_at():
    """All of a second's velocities are still to be driven; none of them came after the scan."""
    for late, passes in ((0.0, True), (1.4, False)):
        guard = VelocityGuard(parameters())
        guard.delay.seconds = late
        for tick in range(20):
            guard.take_scan(scan_with(0.45 if tick == 19 else 3.0, -30, 30 + tick, stamp=0.1 * tick), LASER)
            verdict = judged(guard, AHEAD, 0.1 * tick)
            assert tick == 19 or verdict.velocity == AHEAD
        assert (verdict.velocity == AHEAD) is passes
