"""What a plugin says that no message can hold ends its goal with a text that says so, and nobody else's."""

import io
import sys
from pathlib import Path as File
from types import SimpleNamespace

import numpy as np
import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from genpy import Time
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import ExePathAction, ExePathGoal, ExePathResult, GetPathGoal, RecoveryGoal

sys.path.insert(0, str(File(__file__).resolve().parents[2] / "navigation"))

import scripted
from scripted_bench import Bench

from mbf_relay.geometry import STOP
from mbf_relay.outcomes import (
    ControlError,
    ControlOutcome,
    PlanningError,
    PlanOutcome,
    RecoveryError,
    RecoveryOutcome,
)
from mbf_relay.planning.path import Path
from mbf_relay.ros.common.actions.action_server import ActionServer
from mbf_relay.ros.common.actions.goal_tracker import GoalTracker
from mbf_relay.ros.server.actions import make_actions

POSES = np.zeros((2, 3))
NO_LETTER = "no letter: caf\udce9.yaml"  # a file's name that is no UTF-8, as Python has it


class Answers(GoalTracker):
    """An action server of paper, which writes what its clients are told as a topic does."""

    def __init__(self, name, _type, on_goal, on_cancel, recalled, overtaken_cb):
        self.told = {}
        super().__init__(
            self, on_goal, on_cancel, lambda: None, lambda: 1000.0, lambda: Time(1000), recalled, overtaken_cb)

    def publish_result(self, status, result):
        for part in (status, result):
            part.serialize(io.BytesIO())
        self.told[status.goal_id.id] = status.status, result

    def publish_feedback(self, status, feedback):
        feedback.serialize(io.BytesIO())

    def status_changed(self):
        pass


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def actions(bench):
    return {action.name: action for action in make_actions(bench.navigator, Answers, lambda: Time(1000))}


def step(bench, actions):
    for action in actions.values():
        action.take_up()
    bench.step()
    for action in actions.values():
        action.report()


def goal_at(x):
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
    return pose


def a_path(slot=0, controller=""):
    goal = ExePathGoal(concurrency_slot=slot, controller=controller)
    goal.path.header.frame_id, goal.path.poses = "map", [goal_at(0.0), goal_at(5.0)]
    return goal


def raising(error):
    """Return a script's entry that raises, as plugins do: where they make their exception."""
    def run(*_arguments):
        raise error()

    return run


PLANNER = ("get_path", "plan", lambda: GetPathGoal(target_pose=goal_at(1.0), planner="P1"))
CONTROLLER = ("exe_path", "velocity", lambda: a_path(controller="C1"))
RECOVERY = ("recovery", "recovery", lambda: RecoveryGoal(behavior="R1"))


@pytest.mark.parametrize("plugin, answer, text", [
    (PLANNER, Path(POSES, None), "'P1' failed with TypeError: it returned a path whose frame is None"),
    (PLANNER, Path(POSES, "map", "far"), "'P1' failed with TypeError: it returned a path whose cost is 'far'"),
    (PLANNER, Path(POSES, "map", None), "'P1' failed with TypeError: it returned a path whose cost is None"),
    (PLANNER, Path([[0.0, 0.0, "left"]], "map"), "'P1' failed with TypeError: it returned a path whose poses are no"),
    (PLANNER, Path([[0.0, 0.0, None]], "map"), "'P1' failed with ValueError: it returned a path with poses"),
    (PLANNER, raising(lambda: PlanningError("NO_WAY", "walls")), "'P1' failed with TypeError: 'NO_WAY' is no outcome"),
    (PLANNER, raising(lambda: PlanningError(PlanOutcome.BLOCKED_GOAL, NO_LETTER)), "no letter"),
    (PLANNER, raising(lambda: OSError(NO_LETTER)), "'P1' failed with OSError: no letter"),
    (CONTROLLER, raising(lambda: ControlError(PlanOutcome.FAILURE, "")), "'C1' failed with TypeError: <PlanOutcome.F"),
    (CONTROLLER, raising(lambda: ControlError(ControlOutcome.NO_VALID_CMD, NO_LETTER)), "no letter"),
    (RECOVERY, raising(lambda: RecoveryError(7, "stuck")), "'R1' failed with TypeError: 7 is no outcome"),
    (RECOVERY, raising(lambda: RecoveryError(RecoveryOutcome.IMPASSABLE, NO_LETTER)), "no letter"),
])
def test_a_goal_whose_plugin_says_what_no_message_holds_ends_alone_and_says_what(bench, actions, plugin, answer, text):
    """All goals ended with an internal error that named no plugin, or the client waited for a result for ever."""
    name, entry, goal = plugin
    setattr(bench.script, entry, answer)
    other = actions["recovery" if name == "exe_path" else "exe_path"]
    if name == "exe_path":
        bench.script.recovery = lambda context: iter([STOP] * 100)
    other.server.take_goal(GoalID(id="other"), RecoveryGoal() if name == "exe_path" else a_path(slot=7), "client")
    actions[name].server.take_goal(GoalID(id="asked"), goal(), "client")
    for _ in range(15):  # as long as patience
        step(bench, actions)
    status, result = actions[name].server.told["asked"]
    assert text in result.message and status in (GoalStatus.ABORTED, GoalStatus.SUCCEEDED)
    assert not other.server.told, "whose plugin is all right"


def test_the_robot_stands_when_its_controller_says_what_no_message_holds(bench, actions):
    actions["exe_path"].server.take_goal(GoalID(id="asked"), a_path(), "client")
    step(bench, actions)
    assert bench.robot.sent[-1] == scripted.FORWARD
    bench.script.velocity = raising(lambda: ControlError("stuck", "walls"))
    step(bench, actions)
    assert bench.robot.sent[-1] == STOP and "asked" in actions["exe_path"].server.told


def test_a_client_is_told_of_a_result_that_cannot_be_written(monkeypatch):
    """It waited for ever: the goal had ended, and nobody said so."""
    monkeypatch.setattr("rospy.get_rostime", lambda: Time(1000))
    monkeypatch.setattr("rospy.is_shutdown", lambda: False)
    server = ActionServer("~exe_path", ExePathAction, lambda goal: None, lambda goal: None)
    server._publishes, sent = True, []

    def publish(message):
        message.serialize(io.BytesIO())
        sent.append(message)

    server._result = server._status = SimpleNamespace(name="/exe_path/result", publish=publish)
    server.goals.take_goal(GoalID(id="asked"), a_path(), "client")
    (goal,) = server.goals._goals.values()
    goal.set_accepted()
    server.goals.release()
    goal.set_succeeded(ExePathResult(outcome=ExePathResult.SUCCESS, message=7), "arrived")
    results = [message for message in sent if hasattr(message, "result")]
    assert [message.status.status for message in results] == [GoalStatus.ABORTED]
    assert "cannot be sent" in results[0].status.text and server.goals.listed()[0].status == GoalStatus.ABORTED
