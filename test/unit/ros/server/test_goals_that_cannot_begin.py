"""A goal that cannot begin ends, with what kept it from that, and ends nobody else's."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("mbf_msgs.msg", reason="needs the built package")

from actionlib_msgs.msg import GoalID, GoalStatus  # noqa: E402
from genpy import Time  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from mbf_msgs.msg import ExePathGoal, ExePathResult, GetPathGoal, GetPathResult, MoveBaseGoal, MoveBaseResult  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "navigation"))

import scripted  # noqa: E402
from scripted_bench import Bench  # noqa: E402

from mbf_relay.ros.common.goal_tracker import GoalTracker  # noqa: E402
from mbf_relay.ros.server.actions import make_actions  # noqa: E402


class Lonely:
    """A plugin of which there can be one: whatever it drives through is taken by the first."""

    made = 0

    def __init__(self, name, parameters):
        super().__init__(name, parameters)
        type(self).made += 1
        if self.made > 1:
            raise RuntimeError("the device is taken")


class LonelyController(Lonely, scripted.ScriptedController):
    pass


class LonelyPlanner(Lonely, scripted.ScriptedPlanner):
    pass


class Answers(GoalTracker):
    """An action server of paper, and what its clients are told."""

    def __init__(self, name, _type, on_goal, on_cancel, recalled, overtaken_cb):
        self.told = {}
        super().__init__(
            self, on_goal, on_cancel, lambda: None, lambda: 1000.0, lambda: Time(1000), recalled, overtaken_cb)

    def publish_result(self, status, result):
        assert status.goal_id.id not in self.told, "a goal ended twice"
        self.told[status.goal_id.id] = status.status, result

    def publish_feedback(self, status, feedback):
        pass

    def status_changed(self):
        pass


@pytest.fixture
def served():
    """A navigator with scripted plugins, some of which there can be one of, and its actions by name."""
    LonelyController.made = LonelyPlanner.made = 0
    bench = Bench(
        planners=[{"name": "P1", "type": f"{scripted.__name__}.ScriptedPlanner"},
                  {"name": "lonely", "type": f"{__name__}.LonelyPlanner"}],
        controllers=[{"name": "C1", "type": f"{scripted.__name__}.ScriptedController"},
                     {"name": "lonely", "type": f"{__name__}.LonelyController"}])
    return bench, {action.name: action for action in make_actions(bench.navigator, Answers, lambda: Time(1000))}


def step(bench, actions):
    for action in actions.values():
        action.take_up()
    bench.step()
    for action in actions.values():
        action.report()


def send(action, name, goal):
    action.server.take_goal(GoalID(id=name), goal, "client")


def goal_at(x):
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
    return pose


def test_a_goal_whose_plugin_cannot_be_made_for_its_slot_is_refused_and_the_robot_drives_on(served):
    bench, actions = served
    send(actions["move_base"], "drive", MoveBaseGoal(target_pose=goal_at(5.0)))
    step(bench, actions)
    path = ExePathGoal(controller="lonely", concurrency_slot=3)
    path.path.header.frame_id, path.path.poses = "map", [goal_at(0.0), goal_at(1.0)]
    send(actions["exe_path"], "second", path)
    step(bench, actions)
    status, result = actions["exe_path"].server.told["second"]
    assert (status, result.outcome) == (GoalStatus.REJECTED, ExePathResult.INVALID_PLUGIN)
    assert "the device is taken" in result.message
    step(bench, actions)
    assert not actions["move_base"].server.told and bench.robot.sent[-1] == scripted.FORWARD


def test_a_robot_drives_where_there_is_no_second_planner_for_the_goal(served):
    bench, actions = served
    send(actions["move_base"], "drive", MoveBaseGoal(target_pose=goal_at(5.0), planner="lonely"))
    send(actions["get_path"], "plan", GetPathGoal(target_pose=goal_at(1.0), planner="lonely", concurrency_slot=3))
    for _ in range(3):
        step(bench, actions)
    assert LonelyPlanner.made > 1 and bench.robot.sent[-1] == scripted.FORWARD
    status, result = actions["get_path"].server.told["plan"]
    assert (status, result.outcome) == (GoalStatus.SUCCEEDED, GetPathResult.SUCCESS)


def test_a_goal_in_whose_beginning_navigation_fails_ends_with_all_others_and_the_next_one_works(served, monkeypatch):
    bench, actions = served
    action = actions["move_base"]
    with monkeypatch.context() as broken:
        broken.setattr(action, "_begin_goal", lambda goal: 1 // 0)
        for name in ("first", "second"):
            send(action, name, MoveBaseGoal(target_pose=goal_at(5.0)))
        with pytest.raises(ZeroDivisionError):
            step(bench, actions)
        action.abort_all("INTERNAL_ERROR", "navigation failed")
    assert action.server.told.keys() == {"first", "second"}
    for status, result in action.server.told.values():
        assert (status, result.outcome) == (GoalStatus.ABORTED, MoveBaseResult.INTERNAL_ERROR)
    scripted.arrive(bench, 0.9)
    send(action, "third", MoveBaseGoal(target_pose=goal_at(1.0)))
    for _ in range(200):
        if "third" not in action.server.told:
            step(bench, actions)
    assert action.server.told["third"][0] == GoalStatus.SUCCEEDED
