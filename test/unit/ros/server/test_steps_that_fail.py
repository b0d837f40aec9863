"""A step of navigation that fails, or comes after one that hung, leaves no robot driving and no client waiting."""

import math
from types import SimpleNamespace

import pytest

from mbf_relay.geometry import STOP
from mbf_relay.ros.server.node import MoveBaseFlex


class PaperServer(MoveBaseFlex):
    """A server with nothing behind it, and what it did, in order."""

    def __init__(self):
        self.done, self.failing, self.hung, self.ready = [], "", "", False
        self.navigator = SimpleNamespace(
            update=self.update, drop_all=self.note("drop"), idle=False, due=5.0, parameters=None)
        self.robot = SimpleNamespace(command=self.note("command"), close=self.note("close"))
        self._actions = [SimpleNamespace(
            take_up=self.take_up, report=self.report, abort_all=self.note("abort all"),
            abort_running=self.note("abort running"))]
        self._actions.append(SimpleNamespace(
            take_up=lambda: False, report=lambda: None, abort_all=lambda *_: None, abort_running=lambda *_: None))
        self._watchdog = SimpleNamespace(settle=lambda: self.hung, stop=lambda: None)
        self._stepper = SimpleNamespace(stop=self.note("stop"), clock_loss="")
        self._topics = SimpleNamespace(publish=lambda _now: None)
        self._steps = SimpleNamespace(tick=lambda _now: None)
        self._rest = SimpleNamespace(attend=lambda *_: 7.0)
        self._costmap_nodes, self._trouble = {}, ""

    def note(self, what):
        return lambda *told: self.done.append((what, *told))

    def fail(self, where):
        if self.failing == where:
            raise RuntimeError("broken")

    def take_up(self):
        self.done.append(("take up",))
        self.fail("taking up")
        return self.ready

    def update(self, _now):
        self.done.append(("update",))
        self.fail("updating")

    def report(self):
        self.fail("reporting")


@pytest.fixture
def server():
    return PaperServer()


@pytest.mark.parametrize("where", ["taking up", "updating", "reporting"])
def test_an_error_nobody_foresaw_stops_the_robot_and_ends_all_goals_and_the_next_step_goes_on(server, where):
    server.failing = where
    assert server._step(1.0) == math.inf, "and it is not tried on and on"
    assert server.done[-3:] == [
        ("command", STOP), ("drop",), ("abort all", "INTERNAL_ERROR", "Internal error: RuntimeError: broken")]
    assert server._trouble == "RuntimeError: broken", "for /diagnostics"
    server.failing, server.done[:] = "", []
    assert server._step(2.0) == 5.0 and server.done == [("take up",), ("update",)] and server._trouble == ""


def test_after_a_step_that_hung_the_robot_stands_and_what_waited_is_begun(server):
    server.hung, server.navigator.idle = "navigation hangs in planner.py, line 3", True
    assert server._step(1.0) == 5.0
    assert server.done == [
        ("command", STOP), ("drop",), ("abort running", "INTERNAL_ERROR", "navigation hangs in planner.py, line 3"),
        ("take up",), ("update",)]
    assert server._trouble == server.hung


@pytest.mark.parametrize("idle, ends", [
    (False, [("command", STOP), ("drop",), ("abort all", "INTERNAL_ERROR", "/clock has stood")]), (True, [])])
def test_a_robot_whose_clock_is_lost_stands_and_its_client_is_told(server, idle, ends):
    """No patience ends in a time that stands still."""
    server._stepper.clock_loss, server.navigator.idle = "/clock has stood", idle
    server._step(1.0)
    assert server.done == [("take up",), ("update",), *ends]


@pytest.mark.parametrize("ready, due, step", [(True, 5.0, 1.0), (False, 5.0, 5.0), (False, 9.0, 7.0)])
def test_the_next_step_is_when_a_goal_waits_or_navigation_or_a_costmap_at_rest_is_due(server, ready, due, step):
    server.ready, server.navigator.due = ready, due
    assert server._step(1.0) == step


def test_a_server_that_ends_stops_the_robot_before_anything_that_may_take_long(server):
    server.close()
    assert server.done == [
        ("close",), ("stop",), ("abort all", "STOPPED", "move_base_flex is shutting down")]
