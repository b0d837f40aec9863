"""The goal as it is shown: in the global frame, with a quaternion of length 1."""

import pytest

pytest.importorskip("tf2_ros")

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion

from mbf_relay.ros.goal_frame import GoalFrame


def shown(*quaternion):
    goals = []
    goal = PoseStamped(pose=Pose(Point(1.0, 2.0, 0.3), Quaternion(*quaternion)))
    goal.header.frame_id = "map"
    GoalFrame("map", goals.append).show(goal)
    return goal, goals


def test_the_tutorial_s_rounded_quaternion_is_shown_at_length_one():
    _, goals = shown(0.0, 0.0, -0.112, 0.999)
    turn = goals[0].pose.orientation
    assert turn.z ** 2 + turn.w ** 2 == pytest.approx(1.0, abs=1e-12)
    assert turn.z / turn.w == pytest.approx(-0.112 / 0.999)
    assert (goals[0].header.frame_id, goals[0].pose.position.z) == ("map", 0.3)


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.0, 0.0)])
def test_what_is_right_or_past_mending_stays_as_it_is(quaternion):
    goal, goals = shown(*quaternion)
    assert goals == [goal] and goals[0].pose.orientation == Quaternion(*quaternion)
