"""The pace of simulated time and the gate for commands; neither needs ROS."""

import math
import threading

import pytest

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.ros.simulator.command_synchronizer import FORGET, IN_VAIN, CommandSynchronizer
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
    assert meter.measure(1.0) is None
    clock.now += 2.0
    assert meter.measure(9.0) == pytest.approx(4.0)
    assert meter.measure(9.0) == pytest.approx(4.0)


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


def drive(scan_rate, controller_rate, seconds=5.0):
    """Return the stops that a robot suffered, and the most scans it ever drove on without a new command.

    The simulation goes by scans; the controller answers as soon as the simulated clock shows its time, at which it has
    heard all scans made before. Where the clock stands for half a second, the server stops the robot till it goes on.

    Args:
        scan_rate: Of the lidar (Hz).
        controller_rate: Of the controller (Hz).
        seconds: How long to drive, simulated.
    """
    clock, stops, oldest, commands, answered = WallClock(), 0, 0, 0, 0
    gate = CommandSynchronizer(3.0, clock)
    for scan in range(int(seconds * scan_rate)):
        now = (scan - 0.1) / scan_rate  # a period of the clock before the scan

        def answer(now=now, scan=scan):
            nonlocal commands, answered
            if commands / controller_rate <= now:
                commands, answered = commands + 1, scan
                gate.put(GO)

        def stand(answer=answer, scan=scan):
            nonlocal stops
            answer()
            if answered < scan:
                clock.now += 0.6
                stops += 1
                gate.put(STOP)
            return False

        answer()
        gate.wait_for_answer(stand)
        if gate.take() == STOP:
            gate.put(GO)  # the clock goes on
        gate.scan_made()
        oldest = max(oldest, scan + 1 - answered)
    return stops, oldest


def test_a_controller_slower_than_the_lidar_does_not_stutter():
    assert drive(scan_rate=10.0, controller_rate=5.0) == (2, 2)
    assert drive(scan_rate=10.0, controller_rate=4.0) == (4, 3)
    assert drive(scan_rate=10.0, controller_rate=10.0) == (0, 1)
    assert drive(scan_rate=5.0, controller_rate=10.0) == (0, 1)


def test_a_machine_that_hung_does_not_outrun_its_graph_from_then_on():
    gate = CommandSynchronizer(0.01)
    gate.put(GO)
    for _ in range(IN_VAIN):
        gate.scan_made()
        assert not gate.wait_for_answer(never)
        gate.put(GO)
    gate.scan_made()
    assert gate.wait_for_answer(never), "commands are taken to come with every other scan"
    for _ in range(FORGET):
        gate.put(GO)
        gate.scan_made()
    assert not gate.wait_for_answer(never)


def test_what_was_learned_of_one_drive_is_forgotten_by_the_next():
    gate = CommandSynchronizer(0.01)
    for _ in range(IN_VAIN):
        gate.put(GO)
        gate.scan_made()
        assert not gate.wait_for_answer(never)
    for _ in range(FORGET):
        gate.scan_made()
    gate.put(GO)
    gate.scan_made()
    assert not gate.wait_for_answer(never)
