"""A relay that takes goals from the topic alone, as the tutorials' subscriber does: it has no action and no status."""

import io
from types import SimpleNamespace

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import MoveBaseActionResult

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.ros.common.unread import unread
from mbf_relay.ros.web.hands import Hands
from mbf_relay.ros.web.inbox import Inbox
from mbf_relay.ros.web.robot import ViewedRobot
from mbf_relay.ros.web.robot_view import RobotView
from mbf_relay.view.parameters import WebViewParameters
from mbf_relay.view.wishes import Wish


def viewed():
    """Return the view of a robot, and what puts messages into its inbox."""
    inbox = Inbox({})
    view = RobotView(SimpleNamespace(
        inbox=inbox, namespace="/", base_frame="base", lookup=lambda *_args, **_options: IDENTITY), "map")

    def put(key, message):
        buffer = io.BytesIO()
        message.serialize(buffer)
        inbox.put(key, unread(type(message))().deserialize(buffer.getvalue()), every=True)

    return view, put


def goal():
    message = PoseStamped()
    message.header.frame_id, message.pose.orientation.w = "map", 1.0
    return message


def test_its_goal_is_on_the_way_until_it_ends():
    """The page said from the first moment that move_base had fallen silent, and showed neither goal nor way."""
    view, put = viewed()
    put("goal", goal())
    for now in (1000.0, 1010.0):
        view.update(now)
        assert view.story.as_dict(view.pose, now)["goal"] == [0.0, 0.0, 0.0]


def test_a_move_base_that_has_told_its_status_and_tells_none_any_more_has_fallen_silent():
    view, put = viewed()
    put("goal", goal())
    put("status", GoalStatusArray(status_list=[GoalStatus(status=GoalStatus.ACTIVE)]))
    view.update(1000.0)
    assert view.story.state == "active"
    view.update(1003.5)
    assert (view.story.state, view.story.outcome) == ("failed", "move_base has fallen silent")


def hands(*heard):
    """Return hands with these topics listened to, and the list of those they publish on."""
    made, sent = Hands("/", "map", lambda _words: None), []
    for name in ("move_base/goal", "move_base_simple/goal"):
        made._publishers[name] = SimpleNamespace(
            get_num_connections=lambda name=name: int(name in heard),
            publish=lambda _message, name=name: sent.append(name))
    return made, sent


@pytest.mark.parametrize("heard, has_action, taken", [
    (["move_base/goal", "move_base_simple/goal"], False, "move_base_simple/goal"),
    (["move_base/goal", "move_base_simple/goal"], True, "move_base/goal"),
    (["move_base/goal"], False, "move_base/goal"),
    (["move_base_simple/goal"], True, "move_base_simple/goal"),
])
def test_a_goal_goes_to_it_though_a_recorder_listens_to_the_action(monkeypatch, heard, has_action, taken):
    """Once Record was pressed, or somebody echoed move_base/goal, goals went to the recorder alone, without a word."""
    monkeypatch.setattr("rospy.get_name", lambda: "/web_view")
    made, sent = hands(*heard)
    goal_id = made.goal(IDENTITY, has_action)
    assert sent == [taken] and bool(goal_id) == (taken == "move_base/goal")


def ending(number, status):
    return MoveBaseActionResult(status=GoalStatus(goal_id=GoalID(id=f"/move_base-topic-{number}"), status=status))


@pytest.mark.parametrize("ends", [
    [GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED], [GoalStatus.PREEMPTED, GoalStatus.PREEMPTED], [GoalStatus.ABORTED],
])
def test_a_list_of_waypoints_goes_on_though_its_first_goal_takes_another_s_place(ends):
    """It ended with the goal whose place it took, and the robot drove to its first waypoint alone."""
    told = []
    robot = ViewedRobot("/", WebViewParameters(), None, lambda: None, told.append)
    robot.hands, sent = hands("move_base_simple/goal")
    robot.view, put = viewed()
    put("goal", goal())
    robot.update(1000.0)
    waypoints = [Pose2D(1.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0)]
    robot.do(None, Wish("tour", {"waypoints": waypoints, "loop": False, "pause": 0.0}))
    robot.update(1000.1)
    assert len(sent) == 1
    for number, status in enumerate(ends):
        put("outcome", ending(number, status))
        if number == 0:
            put("goal", goal())
        robot.update(1001.0 + number)
    if ends[-1] == GoalStatus.SUCCEEDED:
        assert len(sent) == 2 and not told
    else:
        assert len(sent) == 1 and told[0].startswith("the list of waypoints ends here")
