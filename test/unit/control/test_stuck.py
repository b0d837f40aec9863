"""A robot that does not move though it is told to: what its owner is told to look at."""

from types import SimpleNamespace

import pytest
from kinematics import PaperRobot, drive, path_through

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.checkers import StuckChecker
from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState
from mbf_relay.control.translated import TranslatedController
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.outcomes import ControlError
from mbf_relay.plugins import create, find_class


def told_of(command):
    """Return what is said of a robot that stands while it is told a velocity."""
    checker = StuckChecker()
    with pytest.raises(ControlError) as raised:
        for cycle in range(50):
            checker.check(seen(0.1 * cycle), command, timeout=2.0)
    return raised.value.message


def seen(now, pose=IDENTITY, expected=IDENTITY, delay=0.0, period=0.1):
    return ControlState(now, expected, STOP, SimpleNamespace(width=0.4), period=period, delay=delay, pose_now=pose)


def test_a_robot_that_stands_is_noticed_also_where_it_is_taken_for_one_whose_commands_come_late():
    """A car stood at its goal for minutes: where it was expected to be turned to and fro with what it was told."""
    checker = StuckChecker()
    with pytest.raises(ControlError, match="has not moved for"):
        for cycle in range(50):
            expected = Pose2D(0.0, 0.0, 0.4 * (cycle % 3))
            checker.check(seen(0.1 * cycle, expected=expected, delay=0.9), Twist2D(0.0, 0.0, 1.0), timeout=2.0)


def test_a_robot_whose_commands_come_late_is_given_the_time_until_they_move_it():
    """Of a timeout of 2 s the first 1.5 s pass before the first command takes effect."""
    checker = StuckChecker()
    for cycle in range(40):
        there = Pose2D(0.1 * max(0.0, 0.1 * cycle - 2.4), 0.0, 0.0)
        checker.check(seen(0.1 * cycle, there, delay=1.5), Twist2D(0.1, 0.0, 0.0), timeout=2.0)


@pytest.mark.parametrize("period", [1.0, 2.0])
def test_a_robot_that_stands_is_noticed_also_where_it_is_told_its_velocity_once_in_a_second_or_two(period):
    """Its owner waited for ever: each cycle was taken for the first one after a pause."""
    checker = StuckChecker()
    with pytest.raises(ControlError, match="has not moved for"):
        for cycle in range(20):
            checker.check(seen(period * cycle, period=period), Twist2D(0.2, 0.0, 0.0), timeout=5.0)


@pytest.mark.parametrize("width, speed, turn", [(1.1, 0.12, 0.0), (0.4, 0.043, 0.0), (1.1, 0.0, 0.055)])
def test_a_car_that_shunts_to_and_fro_as_told_is_not_taken_for_one_whose_wheels_stand(width, speed, turn):
    """A goal was aborted as of a robot that is stuck: a car 1.1 m wide had gone 10 cm ahead and 10 cm back."""
    checker, at = StuckChecker(), 0.0
    for cycle in range(200):
        way = 1.0 if cycle % 18 < 9 else -1.0
        there = SimpleNamespace(
            now=0.1 * cycle, pose=IDENTITY, costmap=SimpleNamespace(width=width), delay=0.0, period=0.1,
            pose_now=Pose2D(speed * at, 0.0, turn * at))
        checker.check(there, Twist2D(way * speed, 0.0, way * turn), timeout=2.0)
        at += way * 0.1


@pytest.mark.parametrize("command, is_turn", [
    (Twist2D(0.0, 0.0, 1.0), True), (Twist2D(0.3, 0.0, 0.5), False), (Twist2D(0.3, 0.0, 0.0), False)])
def test_the_owner_of_a_car_driven_by_turns_on_the_spot_is_told_what_drives_cars(command, is_turn):
    """All that was said was to look at wheels and motors, which were all right."""
    text = told_of(command)
    assert "wheels are free" in text and ("motion_model: Ackermann" in text) is is_turn


TRANSLATED = sorted(
    name for name in CONTROLLERS if issubclass(find_class(name, Controller, CONTROLLERS), TranslatedController))


class Unheard(PaperRobot):
    """A robot whose wheels get none of the velocities."""

    def move(self, command, seconds, step=0.01):
        super().move(STOP, seconds, step)


@pytest.mark.parametrize("name", TRANSLATED)
def test_who_has_another_program_drive_along_the_plan_is_not_given_up_at_its_first_stop(name):
    """A car that followed move_base's plan by a controller of its own lost each goal after waiting for two seconds."""
    def given_up(**values):
        controller = create("planner", name, values, Controller, CONTROLLERS)
        path, robot = path_through((0, 0), (2.0, 0)), Unheard(IDENTITY)
        return any(drive(controller, path, IDENTITY, seconds=6.0, robot=robot).failed)

    assert given_up() and not given_up(stuck_timeout=0.0)
