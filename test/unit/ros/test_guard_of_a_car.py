"""The guard of a car that takes steering angles looks along the arc that those steer it on."""

import threading
from collections import deque
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import Twist, Vector3

from mbf_relay.control.steering import Steering
from mbf_relay.control.velocity_guard import PASSING, Verdict
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.ros.common.clock_watch import ClockWatch
from mbf_relay.ros.velocity_guard.node import VelocityGuardNode

CAR = Steering(0.4)
ON_A_CURVE = Twist2D(0.2, 0.0, 0.25)
TOLD = CAR.steered(ON_A_CURVE)


@pytest.mark.parametrize("steering, velocity", [(CAR, ON_A_CURVE), (None, TOLD)])
def test_what_is_judged_is_a_rate_and_what_passes_half_as_fast_is_the_same_angle(steering, velocity):
    judged, sent = [], []
    half = Twist2D(*(0.5 * part for part in velocity))
    node = VelocityGuardNode.__new__(VelocityGuardNode)
    node.__dict__.update(
        _steering=steering, _scans=deque(), _motion=lambda now: None, _clock=ClockWatch(),
        _commanded=deque([Twist(Vector3(*TOLD[:2], 0.0), Vector3(0.0, 0.0, TOLD.theta))]),
        _guard=SimpleNamespace(
            take_command=lambda now, asked, moving: judged.append(asked),
            verdict=lambda now: Verdict(half, PASSING, "slower")),
        _verdict=Verdict(STOP, PASSING, ""), _counts={}, _sending=threading.Lock(), _closed=False,
        _velocity=SimpleNamespace(publish=sent.append, get_num_connections=lambda: 1), _tell=lambda now: None)
    node._step(1.0)
    assert judged == [pytest.approx(velocity)]
    expected = TOLD.theta if steering else 0.5 * TOLD.theta
    assert [(message.linear.x, message.angular.z) for message in sent] == [(0.1, pytest.approx(expected))]
