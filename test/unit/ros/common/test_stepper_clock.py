"""A robot under a simulated clock: is time going on?"""

import itertools
import math
import threading
from types import SimpleNamespace

import pytest
import rospy
from ros_testing import wait_until
from rosgraph_msgs.msg import Clock

from mbf_relay.ros.common import stepper
from mbf_relay.ros.common.stepper import Stepper
from mbf_relay.timing import Pacer


class Watched:
    """A stepper on a wall clock that the test moves."""

    def __init__(self, monkeypatch):
        self.wall = 100.0
        monkeypatch.setattr(stepper.time, "monotonic", lambda: self.wall)
        monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: False)
        self.stepper = Stepper(lambda now: now)

    def tick(self, now, after):
        self.wall += after
        self.stepper._on_clock(Clock(rospy.Time.from_sec(now)))

    def stands_after(self, seconds):
        self.wall += seconds
        return self.stepper.clock_stands


@pytest.fixture
def watched(monkeypatch):
    return Watched(monkeypatch)


def test_a_robot_whose_clock_nobody_ever_published_stands_and_its_client_is_told(watched, monkeypatch):
    """Real wheels rolled on by the first velocity: in a time that stands at 0 no other one follows, nor any end."""
    assert watched.stands_after(0.0)
    told = SimpleNamespace(get_num_connections=lambda: 0)
    monkeypatch.setattr(stepper.rospy, "Subscriber", lambda *_, **__: told)
    monkeypatch.setattr(stepper.threading, "Thread", lambda **_: SimpleNamespace(start=lambda: None))
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: 1.0)
    watched.stepper = Stepper(lambda now: now)
    watched.stepper.start()
    watched.wall += 19.0
    assert watched.stepper.clock_loss == "", "a simulator may be coming up"
    watched.wall += 2.0
    assert watched.stepper.clock_loss.startswith("nobody has published /clock for 21 s")
    watched.tick(1.0, after=0.1)
    assert watched.stepper.clock_loss == "" and not watched.stands_after(0.1)
    assert watched.stands_after(3.0)
    assert watched.stepper.clock_loss.endswith("and nobody publishes it any more")
    told.get_num_connections = lambda: 1
    assert watched.stepper.clock_loss == "", "goals outlast a simulation that is paused"


def test_a_robot_on_the_machine_s_own_time_is_not_stopped(watched, monkeypatch):
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    watched.stepper = Stepper(lambda now: now)
    assert not watched.stands_after(1e4) and watched.stepper.clock_loss == ""


def test_a_robot_whose_clock_is_paused_is_told_within_half_a_second_also_where_the_time_is_told_on_and_on(watched):
    for count in range(20):
        watched.tick(1.0 + count / 60.0, after=1.0 / 60.0)
    assert not watched.stands_after(0.4)
    watched.tick(1.0 + 19 / 60.0, after=0.05)
    assert watched.stands_after(0.1)
    watched.tick(2.0, after=3.0)
    assert not watched.stands_after(0.4)


def test_a_robot_in_a_simulation_far_below_real_time_is_not_stopped_between_two_ticks(watched):
    for count in range(5):
        watched.tick(1.0 + count / 60.0, after=1.0)
        assert count == 0 or not watched.stands_after(1.0)
        watched.wall -= 1.0 if count else 0.0
    assert watched.stands_after(3.1)


@pytest.mark.parametrize("period", [1.0 / 60.0, 1.0])
def test_a_robot_whose_simulation_stops_again_right_after_a_long_pause_stands(watched, period):
    """As where somebody goes through it step by step: it was taken for one that ticks as rarely as it was paused."""
    for count in range(5):
        watched.tick(1.0 + count / 60.0, after=period)
    watched.tick(2.0, after=100.0)
    assert not watched.stands_after(0.4)
    assert watched.stands_after(3.0)


def test_a_robot_whose_machine_is_set_back_an_hour_between_two_looks_at_the_clock_is_not_left_driving(monkeypatch):
    clock = itertools.chain([5000.0], itertools.repeat(1400.0))
    monkeypatch.setattr(stepper, "STILL_CLOCK", 0.01)
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: next(clock))
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    steps = []

    def step(now):
        steps.append(now)
        return now + 0.1

    stepping = Stepper(step)
    stepping.start()
    wait_until(lambda: 1400.0 in steps, "a step after the clock was set back")
    stepping.stop()


def test_a_node_that_ends_between_two_steps_takes_no_more_of_them(monkeypatch):
    class Overtaken(threading.Event):
        """One that is set by a stop just before it is cleared."""

        def clear(self):
            ending.stop()
            super().clear()

    monkeypatch.setattr(stepper.rospy, "get_time", lambda: 1.0)
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    steps = []
    ending = Stepper(lambda now: steps.append(now) or float("inf"))
    ending._wake = Overtaken()
    ending.start()
    ending._thread.join(5.0)
    assert not ending._thread.is_alive() and not steps


def test_a_node_that_ends_while_nothing_is_due_does_not_wait_for_what_never_comes(monkeypatch):
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: 1.0)
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    steps = []
    ending = Stepper(lambda now: steps.append(now) or math.inf)
    ending.start()
    wait_until(lambda: steps and ending.step_time == 0.0, "its first step")
    ending.stop()
    assert not ending._thread.is_alive()


def test_a_node_that_ends_waits_for_the_running_step_and_for_none_where_it_never_began(monkeypatch):
    """Its last velocity came after the zero, or its end stopped half way at a thread that had never begun."""
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: 1.0)
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    entered, ended = threading.Event(), []

    def step(_now):
        entered.set()
        wait_until(lambda: ending._stopping, "the node's end")
        ended.append(True)
        return math.inf

    ending = Stepper(step)
    ending.start()
    entered.wait(5.0)
    ending.stop()
    assert ended
    Stepper(step).stop()


def test_a_step_that_took_until_after_the_next_was_due_is_followed_by_it_though_the_clock_says_no_more(monkeypatch):
    """The tick came while the step before was running, and the robot was left driving until the next one."""
    clock, steps = [1.0], []
    monkeypatch.setattr(stepper, "STILL_CLOCK", 60.0)
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: clock[0])
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: False)

    def step(now):
        steps.append(now)
        if now == 2.0:
            return math.inf
        clock[0] = 2.0
        stepping._on_clock(Clock(rospy.Time.from_sec(2.0)))
        return 1.1

    stepping = Stepper(step)
    stepping._thread.start()
    wait_until(lambda: steps == [1.0, 2.0], "the step that was due meanwhile")
    stepping.stop()


def test_who_asks_where_a_thread_hangs_that_has_ended_is_told_nothing(watched):
    watched.stepper._began = watched.wall - 10.0
    assert watched.stepper.step_time == 10.0 and watched.stepper.hangs_in == ""


def test_a_robot_whose_clock_ticks_as_often_as_it_is_controlled_misses_no_cycle(monkeypatch):
    """Under Stage's 10 Hz half of the cycles came a tick late: the times they were due at had lost their last digit."""
    clock, steps, pacer = [1.0], [], Pacer()
    monkeypatch.setattr(stepper, "STILL_CLOCK", 60.0)
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: clock[0])
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: False)

    def step(now):
        steps.append(now)
        pacer.passed(now, 0.1)
        return pacer.next

    stepping = Stepper(step)
    stepping._thread.start()
    for count in range(40):
        now = clock[0] = 1.0 + count / 10.0
        stepping._on_clock(Clock(rospy.Time.from_sec(now)))
        wait_until(lambda: len(steps) > count and stepping.step_time == 0.0, f"a step at {now:.1f} s", 5.0, 0.001)
    stepping.stop()
    assert len(steps) == 40
