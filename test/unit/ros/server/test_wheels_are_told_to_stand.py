"""What a dead server sent last does not stand at the wheels once another one is there."""

from types import SimpleNamespace

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

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
