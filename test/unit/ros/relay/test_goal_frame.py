"""The goal as it is shown: in the global frame, with a quaternion of length 1."""

import threading

import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from ros_testing import wait_until

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.relay import goal_frame
from mbf_relay.ros.relay.goal_frame import GoalFrame


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


class NoTransforms:
    """tf that never knows."""

    opened = 0

    def __init__(self):
        NoTransforms.opened += 1

    def lookup(self, target, source):
        raise TransformError(f"no transform from '{source}' to '{target}'")

    def close(self):
        pass


def test_hundreds_of_goals_in_a_frame_nobody_knows_take_one_thread():
    goals, before = [], threading.active_count()
    frame = GoalFrame("map", goals.append, NoTransforms)
    goal = PoseStamped()
    goal.header.frame_id = "atlantis"
    for _ in range(300):
        frame.show(goal)
    assert threading.active_count() <= before + 1 and NoTransforms.opened <= 1
    goal = PoseStamped()
    goal.header.frame_id = "map"
    frame.show(goal)
    assert goals == [goal], "the newest is shown, and those before it no more"
    wait_until(lambda: threading.active_count() <= before, "the thread to end")
    assert goals == [goal], "an older one followed it"


class LateTransforms(NoTransforms):
    """tf that knows at the third look."""

    looks = 0

    def lookup(self, target, source):
        self.looks += 1
        if self.looks < 3:
            raise TransformError("not yet")
        return Pose2D(1.0, 2.0, 0.0)


def test_each_goal_in_another_frame_is_shown_where_it_lies_however_many_came_before():
    goals = []
    frame = GoalFrame("map", goals.append, LateTransforms)
    for number in (1, 2):
        goal = PoseStamped(pose=Pose(Point(0.5 * number, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)))
        goal.header.frame_id = "odom"
        frame.show(goal)
        wait_until(lambda least=number: len(goals) >= least, "the goal")
        place = goals[-1].pose.position
        assert (goals[-1].header.frame_id, place.x, place.y) == ("map", 1.0 + 0.5 * number, 2.0)


def test_a_goal_in_a_frame_nobody_knows_is_shown_as_it_came_in_the_end(monkeypatch):
    monkeypatch.setattr(goal_frame, "TF_TIMEOUT", 0.05)
    goals, goal = [], PoseStamped()
    goal.header.frame_id = "atlantis"
    GoalFrame("map", goals.append, NoTransforms).show(goal)
    wait_until(lambda: goals == [goal], "the goal")


def test_a_goal_is_shown_as_it_came_where_tf_cannot_be_listened_to_and_so_is_the_next():
    goals = []

    def failing():
        raise OSError("too many open files")

    frame = GoalFrame("map", goals.append, failing)
    goal = PoseStamped()
    goal.header.frame_id = "atlantis"
    for shown_by_then in (1, 2):
        frame.show(goal)
        wait_until(lambda least=shown_by_then: len(goals) >= least, "the goal")


def test_a_quaternion_too_long_to_square_is_shown_at_length_one():
    _, goals = shown(0.0, 0.0, 1e200, 1e200)
    assert goals[0].pose.orientation.w == pytest.approx(0.5 ** 0.5)
