"""What a dead server sent last does not stand at the wheels once another one is there."""

import math
import threading
from types import SimpleNamespace

import pytest
import rospy

pytest.importorskip("mbf_msgs", reason="needs the built package")

from mbf_relay.control.command_delay import CommandDelay
from mbf_relay.control.steering import Steering  # noqa: E402
from mbf_relay.geometry import STOP, Twist2D  # noqa: E402
from mbf_relay.ros.server.robot import RosRobot, _Wheels  # noqa: E402


def heard_when(commanded):
    heard = []
    _Wheels(SimpleNamespace(commanded=commanded)).peer_subscribe("cmd_vel", None, heard.append)
    return [(message.linear.x, message.angular.z) for message in heard]


@pytest.mark.parametrize("commanded", [None, STOP])
def test_wheels_that_connect_to_a_server_without_a_drive_are_stopped(commanded):
    assert heard_when(commanded) == [(0.0, 0.0)]


@pytest.mark.parametrize("listeners, said", [(0, "nobody listens to /cmd_vel_raw"), (1, "")])
def test_it_is_said_where_no_wheels_are_left_to_tell(listeners, said):
    publisher = SimpleNamespace(get_num_connections=lambda: listeners, resolved_name="/cmd_vel_raw")
    assert RosRobot.unheard.fget(SimpleNamespace(_publisher=publisher)) == said


def test_wheels_that_connect_during_a_drive_are_left_to_it():
    assert heard_when(Twist2D(0.2, 0.0, 0.0)) == []


@pytest.mark.parametrize("steering, angle", [(None, 0.5), (Steering(0.4, 0.6), math.atan(0.4 * 0.5 / 0.4))])
def test_a_car_is_told_the_angle_that_its_driver_takes_for_a_rate(monkeypatch, steering, angle):
    sent = []
    monkeypatch.setattr(rospy, "get_time", lambda: 1.0)
    robot = RosRobot.__new__(RosRobot)
    robot.__dict__.update(
        steering=steering, commands=SimpleNamespace(tick=lambda now: None), _closing=threading.Lock(), _closed=False,
        _blocked=False, _held=False, _publisher=SimpleNamespace(publish=sent.append), delay=CommandDelay())
    robot.command(Twist2D(0.4, 0.0, 0.5))
    robot.hold(True)
    robot.hold(False)
    robot.close()
    assert [(told.linear.x, told.angular.z) for told in sent] == [
        (0.4, pytest.approx(angle)), (0.0, 0.0), (0.4, pytest.approx(angle)), (0.0, 0.0)]
    assert robot.commanded == Twist2D(0.4, 0.0, 0.5)  # what controllers go on from
