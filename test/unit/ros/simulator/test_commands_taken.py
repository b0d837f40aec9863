"""Velocities as the simulated wheels take them."""

import math

import pytest

pytest.importorskip("pybullet")

from geometry_msgs.msg import Twist, Vector3  # noqa: E402

from mbf_relay.geometry import STOP, Twist2D  # noqa: E402
from mbf_relay.ros.simulator import node  # noqa: E402
from mbf_relay.ros.simulator.command_synchronizer import CommandSynchronizer  # noqa: E402


@pytest.mark.parametrize("nonsense", [math.nan, math.inf, 1e9])
def test_a_robot_whose_driver_computes_nonsense_stops_instead_of_driving_on(monkeypatch, nonsense):
    monkeypatch.setattr(node.rospy, "logwarn_throttle", lambda *_: None)
    simulator = node.Simulator.__new__(node.Simulator)
    simulator._commands = CommandSynchronizer(0.0)
    simulator._take_command(Twist(linear=Vector3(0.2, 0.0, 0.0)))
    assert simulator._commands.take() == Twist2D(0.2, 0.0, 0.0)
    simulator._take_command(Twist(linear=Vector3(nonsense, 0.0, 0.0)))
    assert simulator._commands.take() == STOP
