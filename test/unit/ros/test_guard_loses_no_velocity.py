"""A velocity that comes while the guard takes up the one before it is judged next, above all where it is the zero."""

import sys
import threading
from collections import deque
from types import SimpleNamespace

from geometry_msgs.msg import Twist, Vector3

from mbf_relay.control.velocity_guard import PASSING, Verdict
from mbf_relay.geometry import STOP
from mbf_relay.ros.common.clock_watch import ClockWatch
from mbf_relay.ros.velocity_guard.node import VelocityGuardNode


def guard(asked):
    """Return a guard without topics, which takes note of what it was asked for last."""
    node = VelocityGuardNode.__new__(VelocityGuardNode)
    node.__dict__.update(
        _steering=None, _scans=deque(), _motion=lambda now: None, _clock=ClockWatch(), _woken=threading.Event(),
        _commanded=deque(maxlen=1), _commands=SimpleNamespace(get_num_connections=lambda: 1), _judged_at=0.0,
        _guard=SimpleNamespace(
            take_command=lambda now, velocity, moving: asked.append(velocity.x),
            verdict=lambda now: Verdict(STOP, PASSING, "")),
        _verdict=Verdict(STOP, PASSING, ""), _counts={}, _sending=threading.Lock(), _closed=False,
        _velocity=SimpleNamespace(publish=lambda told: None, get_num_connections=lambda: 1), _tell=lambda now: None)
    return node


def interleave(function, other, moment):
    """Run a function, and another one before its instruction of that number; return whether it has as many."""
    left = [moment]

    def trace(frame, event, _argument):
        if frame.f_code is not function.__func__.__code__:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            left[0] -= 1
            if left[0] == 0:
                other()
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        function(1.0)
    finally:
        sys.settrace(before)
    return left[0] <= 0


def test_no_zero_gets_lost_between_two_instructions():
    moment, more = 0, True
    while more:
        moment += 1
        asked = []
        node = guard(asked)
        node._take_command(Twist(linear=Vector3(x=0.5)))
        more = interleave(node._step, lambda node=node: node._take_command(Twist()), moment)
        node._step(1.0)
        assert asked[-1] == (0.0 if more else 0.5), f"lost before instruction {moment}"
    assert moment > 50
