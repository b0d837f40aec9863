"""A server whose navigation hangs stands; one that goes on drives again."""

import math
import threading
from pathlib import Path

import pytest
from ros_testing import wait_until

from mbf_relay.ros.common import stepper
from mbf_relay.ros.common.diagnostics import ERROR
from mbf_relay.ros.costmap.node import CostmapNode
from mbf_relay.ros.server import watchdog
from mbf_relay.ros.server.watchdog import Watchdog


class PaperStepper:
    step_time, clock_stands, hangs_in, woken = 0.0, False, "planner.py, line 3", False

    def wake(self):
        self.woken = True


class PaperRobot:
    """A robot on which whatever the watchdog does takes effect with a turn of the test's in between."""

    def __init__(self):
        self.blocked, self.held, self.before_block = False, False, lambda: None
        self.looks = 0

    def hold(self, is_held):
        self.held = is_held
        self.looks += 1

    def block(self):
        self.before_block()
        self.blocked = True

    def release(self):
        self.blocked = False


@pytest.fixture
def watched(monkeypatch):
    monkeypatch.setattr(watchdog, "PERIOD", 0.001)
    stepping, robot, ended = PaperStepper(), PaperRobot(), []
    dog = Watchdog(stepping, robot, ended.append, lambda: ["local costmap hangs in my_layer.py, line 7"])
    dog.start()
    yield stepping, robot, ended, dog
    dog.stop()


def test_a_step_that_takes_too_long_stops_the_robot_and_ends_goals_until_the_next_one(watched):
    stepping, robot, ended, dog = watched
    assert dog.is_alive()
    stepping.step_time = stepper.STEP_PATIENCE + 0.1
    assert not dog.is_alive()
    wait_until(lambda: robot.blocked and ended, "the robot to be stopped")
    assert ended[0].startswith("navigation hangs in planner.py, line 3; local costmap hangs in my_layer.py, line 7: ")
    wait_until(lambda: stepping.woken, "the next step, in which everything begins anew, to be called for")
    stepping.step_time = 0.0
    assert "hangs" in dog.settle() and not robot.blocked
    assert dog.settle() == ""


def test_a_computer_that_did_nothing_for_a_while_stops_the_robot_and_the_drive_goes_on(watched):
    """A process that was not run for 2 s, in the middle of a step, ended its goals as if that step hung."""
    stepping, robot, ended, dog = watched

    def goes_on():
        stepping.step_time = 0.0

    wait_until(lambda: robot.looks > 2 * watchdog.LOOKS, "looks at quick steps, which count for none that hangs")
    robot.before_block = goes_on
    stepping.step_time = stepper.STEP_PATIENCE + 1.0
    wait_until(lambda: robot.blocked, "the robot to be stopped")
    assert dog.settle() == "" and not ended and not robot.blocked


def test_a_layer_that_blocks_for_ever_is_named_by_file_and_line(monkeypatch):
    """The client heard that navigation hangs, /diagnostics fell silent, and which of ten plugins it was nobody told."""
    monkeypatch.setattr(stepper, "STEP_PATIENCE", 0.0)
    monkeypatch.setattr(stepper.rospy, "get_time", lambda: 1.0)
    monkeypatch.setattr(stepper.rospy.rostime, "is_wallclock", lambda: True)
    comes_free, entered = threading.Event(), threading.Event()

    def step(_now):
        entered.set()
        comes_free.wait()  # what hangs
        return math.inf

    costmap = CostmapNode.__new__(CostmapNode)
    costmap.__dict__.update(_stepper=stepper.Stepper(step), costmap=None)
    assert costmap.hangs_in == ""
    costmap._stepper.start()
    place = f"{Path(__file__).name}, line {step.__code__.co_firstlineno + 2}"
    wait_until(lambda: entered.is_set() and costmap.hangs_in == place, "the place where it hangs")
    assert costmap.report()[:2] == (ERROR, f"hangs in {place}")
    comes_free.set()
    wait_until(lambda: costmap.hangs_in == "", "the step's end")
    costmap._stepper.stop()


def test_a_robot_let_go_by_a_new_step_is_not_stopped_for_the_old_one(watched, monkeypatch):
    monkeypatch.setattr(watchdog, "LOOKS", 1)
    stepping, robot, _, dog = watched
    settled = []

    def begin_a_step():
        robot.before_block = lambda: None
        stepping.step_time = 0.0
        thread = threading.Thread(target=lambda: settled.append(dog.settle()), daemon=True)
        thread.start()
        thread.join(0.05)  # it may only come through once the robot is stopped

    robot.before_block = begin_a_step
    stepping.step_time = stepper.STEP_PATIENCE + 0.1
    wait_until(lambda: settled, "the next step")
    assert settled[0]
    wait_until(lambda: not robot.blocked, "the robot to be let go")


def test_wheels_stand_while_the_clock_does(watched):
    stepping, robot, ended, _ = watched
    stepping.clock_stands = True
    wait_until(lambda: robot.held, "the wheels to be held")
    stepping.clock_stands = False
    wait_until(lambda: not robot.held, "the wheels to be let go")
    assert not ended
