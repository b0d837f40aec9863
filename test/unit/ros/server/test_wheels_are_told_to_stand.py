"""What a dead server sent last does not stand at the wheels once another one is there."""

import math
import threading
from types import SimpleNamespace

import pytest
import rospy
from std_msgs.msg import String

from mbf_relay.control.steering import Steering
from mbf_relay.control.velocity_guard import OBSTACLE, PASSING, VelocityGuard, _slowed
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.ros.server.robot import OBJECTS, PASSES, RosRobot, _Wheels

FORWARD = Twist2D(0.2, 0.0, 0.0)


@pytest.mark.parametrize("listeners, said", [(0, "nobody listens to /cmd_vel_raw"), (1, "")])
def test_it_is_said_where_no_wheels_are_left_to_tell(listeners, said):
    publisher = SimpleNamespace(get_num_connections=lambda: listeners, resolved_name="/cmd_vel_raw")
    assert RosRobot.unheard.fget(SimpleNamespace(_publisher=publisher)) == said


@pytest.mark.parametrize("states, said", [
    (["stopped: a foot"], "velocity_guard says 'stopped: a foot'"),
    (["slowed down to 20 %: a wall", "standing: no velocity is asked for"],
     "velocity_guard says 'slowed down to 20 %: a wall'"),
    (["stopped: a foot", "passing"], ""), (["standing: no velocity is asked for"], "")])
def test_what_the_guard_has_against_the_last_drive_is_known(states, said):
    robot = RosRobot.__new__(RosRobot)
    robot._objection = ""
    for state in states:
        robot._hear_guard(String(state))
    assert robot.held_back == said


def test_the_guard_speaks_in_the_words_that_are_listened_for():
    guard = VelocityGuard(VelocityGuardParameters())
    guard.take_command(1.0, FORWARD)
    assert guard.verdict(1.0).text.startswith(OBJECTS)  # it has no scan
    assert _slowed(FORWARD, 0.5, OBSTACLE, "a foot").text.startswith(OBJECTS)
    guard.take_command(1.0, STOP)
    assert not guard.verdict(1.0).text.startswith((*OBJECTS, PASSES))
    assert PASSING == PASSES


@pytest.fixture
def robot(monkeypatch):
    """A robot, and what its wheels are told."""
    monkeypatch.setattr(rospy, "get_time", lambda: 1.0)
    made, sent, noted = RosRobot.__new__(RosRobot), [], []
    made.__dict__.update(
        steering=None, commands=SimpleNamespace(tick=lambda now: None), _closing=threading.Lock(), _closed=False,
        _blocked=False, _held=False, told=STOP, sent=sent, noted=noted,
        delay=SimpleNamespace(tell=lambda now, velocity: noted.append((now, velocity))),
        _publisher=SimpleNamespace(publish=lambda message: sent.append((message.linear.x, message.angular.z))))
    return made


@pytest.mark.parametrize("halt", [
    None, lambda robot: robot.command(STOP), lambda robot: robot.hold(True), RosRobot.block, RosRobot.close],
    ids=["no drive yet", "a drive that is over", "time that stands", "a hung step", "the server's end"])
def test_wheels_that_connect_while_nobody_drives_them_are_stopped_and_else_left_to_the_drive(robot, halt):
    """What a server that died sent last drove them on."""
    heard, wheels = [], _Wheels(robot)
    if halt is not None:
        robot.command(FORWARD)
        wheels.peer_subscribe("cmd_vel", None, heard.append)
        assert heard == []
        halt(robot)
    wheels.peer_subscribe("cmd_vel", None, heard.append)
    assert [(message.linear.x, message.angular.z) for message in heard] == [(0.0, 0.0)]


@pytest.mark.parametrize("steering, angle", [(None, 0.5), (Steering(0.4, 0.6), math.atan(0.4 * 0.5 / 0.4))])
def test_a_car_is_told_the_angle_that_its_driver_takes_for_a_rate(robot, steering, angle):
    robot.steering = steering
    robot.command(Twist2D(0.4, 0.0, 0.5))
    robot.hold(True)
    robot.hold(False)
    robot.close()
    assert robot.sent == [(0.4, pytest.approx(angle)), (0.0, 0.0), (0.4, pytest.approx(angle)), (0.0, 0.0)]
    assert robot.commanded == Twist2D(0.4, 0.0, 0.5)  # what controllers go on from
    assert robot.noted == [(1.0, each) for each in (robot.commanded, STOP, robot.commanded, STOP)]  # to learn from


def test_a_robot_hears_nothing_between_the_zero_of_a_hung_step_and_the_next_one_nor_after_the_last(robot):
    robot.command(FORWARD)
    robot.block()
    robot.command(FORWARD)
    robot.hold(True)
    robot.hold(False)
    assert robot.sent == [(0.2, 0.0), (0.0, 0.0)] and robot.commanded == STOP
    robot.release()
    robot.command(FORWARD)
    robot.close()
    for late in (lambda: robot.command(FORWARD), robot.block, lambda: robot.hold(True), robot.close):
        late()
    assert robot.sent == [(0.2, 0.0), (0.0, 0.0)] * 2


def test_a_robot_in_whose_simulation_time_stands_is_told_once_and_drives_on_by_the_newest_velocity(robot):
    robot.hold(True)
    robot.hold(False)
    assert robot.sent == [], "nothing goes out of a robot that stands"
    robot.command(FORWARD)
    for _ in range(3):
        robot.hold(True)
    robot.command(Twist2D(0.1, 0.0, 0.0))
    robot.hold(False)
    robot.command(STOP)
    robot.hold(True)
    assert robot.sent == [(0.2, 0.0), (0.0, 0.0), (0.0, 0.0), (0.1, 0.0), (0.0, 0.0)]


def test_a_velocity_that_is_no_number_stops_the_wheels_and_counts_as_the_stop_it_became(robot):
    robot.command(FORWARD)
    robot.command(Twist2D(0.2, 0.0, math.nan))
    assert robot.sent == [(0.2, 0.0), (0.0, 0.0)] and robot.commanded == STOP
