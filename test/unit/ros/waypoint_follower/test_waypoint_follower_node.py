"""Goals of waypoints one right after another, before a move_base of paper."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

from actionlib_msgs.msg import GoalID, GoalStatus  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402

from mbf_relay.msg import FollowWaypointsGoal  # noqa: E402
from mbf_relay.navigation.waypoints import WaypointFollowerParameters  # noqa: E402
from mbf_relay.ros.common.actions.client_goals import ActionEnding  # noqa: E402
from mbf_relay.ros.waypoint_follower import node as waypoint_follower  # noqa: E402


class PaperGoal:
    """A goal of the action."""

    def __init__(self, name):
        self.name, self.ends = name, []
        for way in ("accepted", "canceled", "aborted", "succeeded"):
            setattr(self, f"set_{way}", lambda *_, way=way: self.ends.append(way))

    def get_goal_id(self):
        return GoalID(id=self.name)

    def get_goal(self):
        return FollowWaypointsGoal(poses=[PoseStamped()])

    def publish_feedback(self, _feedback):
        pass


class PaperMoveBase:
    """Never arrives; keeps what it was sent."""

    def __init__(self):
        self.sent = []

    def check(self):
        pass

    def send(self, _goal):
        sent = SimpleNamespace(ending=None, is_cancelled=False)
        sent.cancel = lambda: setattr(sent, "is_cancelled", True)
        self.sent.append(sent)
        return sent


@pytest.fixture
def follower(monkeypatch):
    move_base = PaperMoveBase()
    monkeypatch.setattr(waypoint_follower, "check_alone", lambda _action: None)
    monkeypatch.setattr(waypoint_follower, "on_shutdown", lambda _words: None)
    monkeypatch.setattr(waypoint_follower, "ActionClient", lambda *_, **__: move_base)
    monkeypatch.setattr(
        waypoint_follower, "ActionServer",
        lambda _name, _type, take, cancel, **more: SimpleNamespace(
            lock=threading.RLock(), start=lambda: None, take=take, cancel=cancel, **more))
    monkeypatch.setattr(
        waypoint_follower, "WaypointTopics", lambda _parameters: SimpleNamespace(show=lambda _poses: None))
    node = waypoint_follower.WaypointFollowerNode(WaypointFollowerParameters())
    return SimpleNamespace(node=node, move_base=move_base)


def test_a_robot_stands_where_the_goal_that_took_the_place_of_another_is_called_off_at_once(follower):
    older, newer = PaperGoal("older"), PaperGoal("newer")
    follower.node._server.take(older)
    follower.node.look(1.0)
    follower.node._server.take(newer)
    assert not follower.move_base.sent[0].is_cancelled  # the robot drives on until move_base has the new one
    follower.node._server.cancel(newer)
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    follower.node.look(1.05)
    assert (older.ends, newer.ends) == (["accepted", "canceled"], ["accepted", "canceled"])


def test_a_robot_stands_where_the_cancel_of_what_took_its_goals_place_comes_first(follower):
    older = PaperGoal("older")
    follower.node._server.take(older)
    follower.node.look(1.0)
    follower.node._server.overtaken_cb(PaperGoal("newer"))
    follower.node.look(1.05)
    assert [sent.is_cancelled for sent in follower.move_base.sent] == [True]
    assert older.ends == ["accepted", "canceled"]


@pytest.mark.parametrize("is_cancelled, warnings", [(True, []), (False, ["no way"])])
def test_who_calls_waypoints_off_is_not_warned_that_one_was_not_reached(follower, monkeypatch, is_cancelled, warnings):
    """The log said `waypoint 0 was not reached:`, and no reason."""
    warned = []
    monkeypatch.setattr(waypoint_follower.rospy, "logwarn", lambda _text, _number, reason: warned.append(reason))
    goal = PaperGoal("goal")
    follower.node._server.take(goal)
    follower.node.look(1.0)
    if is_cancelled:
        follower.node._server.cancel(goal)
    status, text = (GoalStatus.PREEMPTED, "") if is_cancelled else (GoalStatus.ABORTED, "no way")
    follower.move_base.sent[0].ending = ActionEnding(status, text, None)
    follower.node.look(1.05)
    assert warned == warnings
    assert goal.ends == ["accepted", "canceled" if is_cancelled else "succeeded"]
