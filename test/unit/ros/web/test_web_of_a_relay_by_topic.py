"""A relay that takes goals from the topic alone, as the tutorials' subscriber does: it has no action and no status."""

import io
from types import SimpleNamespace

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

from actionlib_msgs.msg import GoalStatus, GoalStatusArray  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402

from mbf_relay.geometry import IDENTITY  # noqa: E402
from mbf_relay.ros.common.unread import unread  # noqa: E402
from mbf_relay.ros.web.inbox import Inbox  # noqa: E402
from mbf_relay.ros.web.robot_view import RobotView  # noqa: E402


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
