"""A guard that knows how late wheels do what they are told, or takes them to be late."""

import math

import pytest
from guarded import AHEAD, LASER, guard_that_saw, judged, parameters, scan_with

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
