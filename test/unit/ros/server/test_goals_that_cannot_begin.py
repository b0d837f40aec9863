"""A goal that cannot begin ends, with what kept it from that, and ends nobody else's."""

import math
import sys
from pathlib import Path

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from genpy import Time
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import ExePathGoal, ExePathResult, GetPathGoal, GetPathResult, MoveBaseGoal, MoveBaseResult

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "navigation"))

import scripted
from scripted_bench import Bench

from mbf_relay.ros.common.actions.goal_tracker import GoalTracker
from mbf_relay.ros.server.actions import BEGUN_PER_STEP, make_actions


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
        self.told, self.heard, self.clock = {}, [], 1000.0
        super().__init__(
            self, on_goal, on_cancel, lambda: None, lambda: self.clock, lambda: Time(1000), recalled, overtaken_cb)

    def publish_result(self, status, result):
        assert status.goal_id.id not in self.told, "a goal ended twice"
        self.told[status.goal_id.id] = status.status, result

    def publish_feedback(self, status, feedback):
        self.heard.append((status.goal_id.id, feedback))

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


def test_a_goal_that_is_none_ends_alone_and_says_why(served, monkeypatch):
    bench, actions = served
    action = actions["move_base"]
    send(action, "drive", MoveBaseGoal(target_pose=goal_at(5.0)))
    step(bench, actions)
    send(action, "nowhere", MoveBaseGoal(target_pose=goal_at(math.nan)))
    monkeypatch.setattr(action, "_read", lambda goal: 1 // 0)
    send(action, "unread", MoveBaseGoal(target_pose=goal_at(1.0)))
    step(bench, actions)
    for name, said in ("nowhere", "nan"), ("unread", "could not be read: ZeroDivisionError"):
        status, result = action.server.told[name]
        assert status == GoalStatus.ABORTED and said in result.message and result.outcome != MoveBaseResult.SUCCESS
    step(bench, actions)
    assert "drive" not in action.server.told and bench.robot.sent[-1] == scripted.FORWARD


def test_a_goal_called_off_before_it_began_stops_what_it_would_have_replaced_and_nobody_else(served):
    bench, actions = served
    plan = actions["get_path"]
    bench.script.plan = scripted.NO_WAY
    for slot in 1, 2:
        send(plan, f"slot {slot}", GetPathGoal(target_pose=goal_at(1.0), concurrency_slot=slot))
    step(bench, actions)
    send(plan, "late", GetPathGoal(target_pose=goal_at(2.0), concurrency_slot=2))
    plan.server.take_cancel(GoalID(id="late"))
    step(bench, actions)
    assert plan.server.told.keys() == {"late", "slot 2"}
    for status, result in plan.server.told.values():
        assert status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED) and result.outcome == GetPathResult.CANCELED
        assert result.message


def test_goals_that_wait_for_their_turn_survive_a_step_that_hung_and_those_called_off_do_not(served):
    """They were given up with what hung, and never begun."""
    bench, actions = served
    action = actions["move_base"]
    send(action, "hangs", MoveBaseGoal(target_pose=goal_at(5.0)))
    step(bench, actions)
    for name in "called off", "waits":
        send(action, name, MoveBaseGoal(target_pose=goal_at(1.0)))
    action.server.take_cancel(GoalID(id="called off"))
    action.abort_running("INTERNAL_ERROR", "navigation hangs")
    bench.navigator.drop_all()
    assert {name: status for name, (status, _) in action.server.told.items()} == dict.fromkeys(
        ("hangs", "called off"), GoalStatus.ABORTED)
    step(bench, actions)
    step(bench, actions)
    assert action.server.told.keys() == {"hangs", "called off"} and bench.robot.sent[-1] == scripted.FORWARD


def test_of_many_goals_at_once_some_are_begun_in_each_step_and_none_is_forgotten(served):
    bench, actions = served
    for slot in range(2 * BEGUN_PER_STEP + 1):
        send(actions["get_path"], f"{slot}", GetPathGoal(target_pose=goal_at(1.0), concurrency_slot=slot))
    begun, told = [], actions["get_path"].server.told
    while len(begun) < 3:
        more = actions["get_path"].take_up()
        bench.step()
        actions["get_path"].report()
        begun.append((len(told), more))
    assert begun == [(BEGUN_PER_STEP, True), (2 * BEGUN_PER_STEP, True), (2 * BEGUN_PER_STEP + 1, False)]


def test_a_client_that_is_gone_is_named_as_why_its_goal_ended(served):
    bench, actions = served
    action = actions["move_base"]
    send(action, "mine", MoveBaseGoal(target_pose=goal_at(5.0)))
    step(bench, actions)
    action.server.clock += 1.0
    for _ in range(2):
        action.server.update(connected=lambda node: False, client_timeout=0.1)
    step(bench, actions)
    status, result = action.server.told["mine"]
    assert status == GoalStatus.PREEMPTED and "its client client is not connected any more" in result.message


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


def test_a_goal_refused_in_a_step_that_fails_or_hangs_afterwards_is_refused_all_the_same(served):
    """Refused and not told so yet, it was to be aborted, which no goal can be that was not accepted: it never ended."""
    _, actions = served
    action = actions["get_path"]
    for name, end_all in ("failed", action.abort_all), ("hung", action.abort_running):
        send(action, name, GetPathGoal(target_pose=goal_at(1.0), planner="unknown"))
        action.take_up()
        end_all("INTERNAL_ERROR", "navigation stands still")
        action.report()
        status, result = action.server.told[name]
        assert (status, result.outcome) == (GoalStatus.REJECTED, GetPathResult.INVALID_PLUGIN)


def test_whatever_comes_wakes_navigation_which_sleeps_until_then():
    """A goal would have waited for the next one, and a robot would have driven on after a cancel for a while."""
    bench, woken = Bench(), []
    actions = {action.name: action for action in make_actions(
        bench.navigator, Answers, lambda: Time(1000), wake=lambda: woken.append(True))}
    server = actions["move_base"].server
    for come in (
        lambda: send(actions["move_base"], "drive", MoveBaseGoal(target_pose=goal_at(5.0))),
        lambda: server.take_cancel(GoalID(id="drive")),
        lambda: [server.take_cancel(GoalID(id="late")), woken.clear(),
                 send(actions["move_base"], "late", MoveBaseGoal(target_pose=goal_at(5.0)))],
    ):
        woken.clear()
        come()
        assert woken
        step(bench, actions)


def test_a_goal_is_begun_when_its_message_has_been_read_and_its_client_hears_how_it_goes():
    bench, reader = Bench(), scripted.HeldWorker()
    actions = {action.name: action for action in make_actions(
        bench.navigator, Answers, lambda: Time(1000), worker=reader)}
    action = actions["move_base"]
    send(action, "drive", MoveBaseGoal(target_pose=goal_at(5.0)))
    assert not action.take_up() and bench.navigator.idle
    step(bench, actions)
    assert not action.server.told and not bench.robot.sent
    reader.step()
    step(bench, actions)
    assert bench.robot.sent == [scripted.FORWARD]
    step(bench, actions)
    (name, feedback), = action.server.heard[-1:]
    assert name == "drive" and feedback.last_cmd_vel.twist.linear.x == scripted.FORWARD.x
