"""The pace of simulated time and the gate for commands; neither needs ROS."""

import math
import threading

import pytest

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.ros.simulator.command_synchronizer import CommandSynchronizer
from mbf_relay.ros.simulator.pacing import CATCH_UP, FactorMeter, RealTimePacer

GO = Twist2D(0.1, 0.0, 0.0)


class WallClock:
    """A wall clock that goes on only by waiting, and by `work`."""

    def __init__(self):
        self.now = 100.0
        self.waits = []

    def __call__(self):
        return self.now

    def wait(self, seconds):
        self.waits.append(seconds)
        self.now += seconds


@pytest.mark.parametrize("factor, seconds", [(1.0, 10.0), (4.0, 2.5), (0.5, 20.0)])
def test_keeps_the_factor(factor, seconds):
    clock = WallClock()
    pacer = RealTimePacer(factor, clock, clock.wait)
    for _ in range(600):
        clock.now += 1e-4
        pacer.pace(1.0 / 60.0)
    assert clock.now - 100.0 == pytest.approx(seconds, rel=1e-3)


def test_without_a_limit_it_never_waits():
    clock = WallClock()
    pacer = RealTimePacer(0.0, clock, clock.wait)
    for _ in range(100):
        pacer.pace(1.0)
    assert clock.waits == []


def test_small_delays_are_made_up_for_and_long_ones_let_go():
    clock = WallClock()
    pacer = RealTimePacer(1.0, clock, clock.wait)
    clock.now += 0.2
    for _ in range(100):
        pacer.pace(0.01)
    assert clock.now - 100.0 == pytest.approx(1.0, abs=0.02)
    clock.now += 60.0
    before = clock.now
    for _ in range(100):
        pacer.pace(0.01)
    assert clock.now - before == pytest.approx(1.0 - CATCH_UP, abs=0.02)
    clock.now += 60.0
    pacer.restart()
    before = clock.now
    pacer.pace(0.5)
    assert clock.now - before == pytest.approx(0.5)


def test_the_achieved_factor_is_measured():
    clock = WallClock()
    meter = FactorMeter(1.0, clock)
    assert meter.look(1.0) is None
    clock.now += 2.0
    assert meter.look(9.0) == pytest.approx(4.0)
    assert meter.look(9.0) == pytest.approx(4.0)


def test_the_newest_command_is_taken_once():
    gate = CommandSynchronizer(0.0)
    assert gate.take() is None
    gate.put(GO)
    gate.put(STOP)
    assert gate.take() == STOP and gate.take() is None and gate.heard == 2


def never():
    return False


def test_nobody_is_waited_for_who_does_not_drive():
    gate = CommandSynchronizer(60.0)
    gate.scan_made()
    assert gate.wait_for_answer(never)
    gate.put(STOP)
    gate.scan_made()
    assert gate.wait_for_answer(never)


def test_a_driver_is_waited_for_until_the_answer_comes():
    gate = CommandSynchronizer(math.inf)
    gate.put(GO)
    gate.scan_made()
    done = threading.Event()

    def wait():
        assert gate.wait_for_answer(never)
        done.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    assert not done.is_set()
    gate.put(GO)
    assert done.wait(10.0)
    thread.join(10.0)
    assert gate.wait_for_answer(never)


def test_a_driver_who_falls_silent_is_given_up_once():
    gate = CommandSynchronizer(0.02)
    gate.put(GO)
    gate.scan_made()
    assert not gate.wait_for_answer(never)
    assert gate.given_up == 1
    assert gate.wait_for_answer(never)
    gate.scan_made()
    assert gate.wait_for_answer(never)


def test_a_cancelled_wait_ends_at_once():
    gate = CommandSynchronizer(math.inf)
    gate.put(GO)
    gate.scan_made()
    assert gate.wait_for_answer(lambda: True)
