"""Goals of waypoints one right after another, before a move_base of paper."""

import threading
from types import SimpleNamespace

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseStamped

from mbf_relay.msg import FollowWaypointsGoal
from mbf_relay.navigation.waypoints import WaypointFollowerParameters
from mbf_relay.ros.common.actions.client_goals import ActionEnding
from mbf_relay.ros.waypoint_follower import node as waypoint_follower


class PaperGoal:
    """A goal of the action, to one place if nothing else is said."""

    def __init__(self, name, **wanted):
        self.name, self.ends, self.texts = name, [], []
        self.wanted = FollowWaypointsGoal(**{"poses": [PoseStamped()], **wanted})
        for way in ("accepted", "rejected", "canceled", "aborted", "succeeded"):
            setattr(self, f"set_{way}", lambda *told, way=way: self.end(way, *told))

    def end(self, way, *told):
        self.ends.append(way)
        self.missed = told[0].missed_waypoints if told else []
        self.texts += told[1:]

    def get_goal_id(self):
        return GoalID(id=self.name)

    def get_goal(self):
        return self.wanted

    def publish_feedback(self, _feedback):
        pass


class PaperMoveBase:
    """Never arrives; keeps what it was sent."""

    def __init__(self):
        self.sent, self.options = [], {}

    def connect(self, _name, _action, **options):
        self.options = options
        return self

    def check(self):
        pass

    def cancel_all(self):
        for sent in self.sent:
            sent.cancel()

    def send(self, _goal):
        sent = SimpleNamespace(ending=None, is_cancelled=False)
        sent.cancel = lambda: setattr(sent, "is_cancelled", True)
        self.sent.append(sent)
        return sent


@pytest.fixture
def follower(monkeypatch):
    move_base, ends = PaperMoveBase(), []
    monkeypatch.setattr(waypoint_follower, "check_alone", lambda _action: None)
    monkeypatch.setattr(waypoint_follower, "on_shutdown", ends.append)
    monkeypatch.setattr(waypoint_follower, "ActionClient", move_base.connect)
    monkeypatch.setattr(
        waypoint_follower, "ActionServer",
        lambda _name, _type, take, cancel, **more: SimpleNamespace(
            lock=threading.RLock(), start=lambda: None, take=take, cancel=cancel, **more))
    monkeypatch.setattr(
        waypoint_follower, "WaypointTopics", lambda _parameters: SimpleNamespace(show=lambda _poses: None))
    node = waypoint_follower.WaypointFollowerNode(WaypointFollowerParameters())
    return SimpleNamespace(node=node, move_base=move_base, ends=ends)


def test_a_robot_stands_where_the_goal_that_took_the_place_of_another_is_called_off_at_once(follower):
    older, newer = PaperGoal("older"), PaperGoal("newer")
    follower.node._server.take(older)
    follower.node.update(1.0)
    follower.node._server.take(newer)
    assert not follower.move_base.sent[0].is_cancelled  # the robot drives on until move_base has the new one
    follower.node._server.cancel(newer)
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    follower.node.update(1.05)
    assert (older.ends, newer.ends) == (["accepted", "canceled"], ["accepted", "canceled"])


def test_a_robot_stands_where_the_cancel_of_what_took_its_goals_place_comes_first(follower):
    older = PaperGoal("older")
    follower.node._server.take(older)
    follower.node.update(1.0)
    follower.node._server.overtaken_cb(PaperGoal("newer"))
    follower.node.update(1.05)
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    assert older.ends == ["accepted", "canceled"]


@pytest.mark.parametrize("is_cancelled, warnings", [(True, []), (False, ["no way"])])
def test_who_calls_waypoints_off_is_not_warned_that_one_was_not_reached(follower, monkeypatch, is_cancelled, warnings):
    """The log said `waypoint 0 was not reached:`, and no reason."""
    warned = []
    monkeypatch.setattr(waypoint_follower.rospy, "logwarn", lambda _text, _number, reason: warned.append(reason))
    goal = PaperGoal("goal")
    follower.node._server.take(goal)
    follower.node.update(1.0)
    if is_cancelled:
        follower.node._server.cancel(goal)
    status, text = (GoalStatus.PREEMPTED, "") if is_cancelled else (GoalStatus.ABORTED, "no way")
    follower.move_base.sent[0].ending = ActionEnding(status, text, None)
    follower.node.update(1.05)
    assert warned == warnings
    assert goal.ends == ["accepted", "canceled" if is_cancelled else "succeeded"]


def test_a_robot_stands_where_a_goal_overtaken_by_its_cancel_finds_two_goals_one_of_them_not_begun(follower):
    """It drove on for the first: whoever had replaced it was called off before move_base was given another goal."""
    older, newer = PaperGoal("older"), PaperGoal("newer")
    follower.node._server.overtaken_cb(PaperGoal("before there is any"))
    follower.node._server.take(older)
    follower.node.update(1.0)
    follower.node._server.take(newer)
    follower.node._server.overtaken_cb(PaperGoal("newest"))
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    assert newer.ends == ["accepted", "canceled"]


def test_who_calls_off_a_goal_that_has_ended_does_not_stop_the_next_one(follower):
    older, newer = PaperGoal("older"), PaperGoal("newer")
    follower.node._server.take(older)
    follower.node._server.cancel(older)
    follower.node.update(1.0)
    follower.node._server.cancel(older)
    follower.node._server.take(newer)
    follower.node._server.cancel(older)
    follower.node.update(1.05)
    assert newer.ends == ["accepted"] and [sent.is_cancelled for sent in follower.move_base.sent] == [False]


def test_a_goal_without_places_is_refused_and_the_robot_goes_on_to_those_of_the_last_one(follower):
    running, empty = PaperGoal("running"), PaperGoal("empty", poses=[])
    follower.node._server.take(running)
    follower.node.update(1.0)
    follower.node._server.take(empty)
    assert empty.ends == ["rejected"] and running.ends == ["accepted"]
    assert not follower.move_base.sent[0].is_cancelled


@pytest.mark.parametrize("status, text, told", [
    (GoalStatus.LOST, "move_base is gone", "move_base is gone"),
    (GoalStatus.PREEMPTED, "", "move_base was given another goal, or called off")])
def test_a_robot_that_somebody_else_sends_elsewhere_is_left_to_him(follower, status, text, told):
    goal = PaperGoal("goal", poses=[PoseStamped()] * 3)
    follower.node._server.take(goal)
    follower.node.update(1.0)
    follower.move_base.sent[0].ending = ActionEnding(status, text, None)
    follower.node.update(1.05)
    follower.node.update(1.1)
    assert goal.ends == ["accepted", "aborted"] and goal.texts == [f"on the way to waypoint 0: {told}"]
    assert goal.missed == [0] and len(follower.move_base.sent) == 1


def test_a_robot_whose_follower_ends_or_dies_stands(follower):
    """Of one that dies move_base hears no cancel; only its goals' leases end."""
    goal = PaperGoal("goal")
    follower.node._server.take(goal)
    for now in (1.0, 1.05):
        follower.node.update(now)
    assert follower.move_base.options["leased"]
    (close,) = follower.ends
    close()
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    assert goal.ends == ["accepted", "aborted"]


def test_a_robot_stands_as_long_as_asked_at_each_waypoint(follower):
    follower.node._server.take(PaperGoal("goal", poses=[PoseStamped()] * 2, waypoint_pause_duration=2.0))
    follower.node.update(1.0)
    follower.move_base.sent[0].ending = ActionEnding(GoalStatus.SUCCEEDED, "", None)
    for now in (1.05, 2.0, 3.0):
        follower.node.update(now)
        assert len(follower.move_base.sent) == 1
    follower.node.update(3.1)
    assert len(follower.move_base.sent) == 2
