"""In which frame a path is taken that a client sends to exe_path: Move Base Flex goes by its poses' own."""

import pytest
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import ExePathGoal

from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.ros.server.messages import follow_goal


def goal(frame, *frames):
    """Return a goal whose path has this frame, and whose poses have these."""
    goal = ExePathGoal()
    goal.path.header.frame_id = frame
    for number, pose_frame in enumerate(frames):
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = pose_frame, 0.1 * number, 1.0
        goal.path.poses.append(pose)
    return goal


@pytest.mark.parametrize("frame, frames, taken", [
    ("map", ("odom", "odom"), "odom"),  # a header left as it was by who took the path to odom
    ("", ("odom", "odom"), "odom"), ("map", ("", ""), "map"), ("map", ("odom", ""), "odom"),
    ("map", ("/map", "map"), "map"), ("/map", ("", ""), "map"),
])
def test_a_robot_does_not_follow_a_path_in_odom_as_if_it_lay_in_the_map(frame, frames, taken):
    assert follow_goal(goal(frame, *frames)).path.frame == taken


def test_a_path_in_two_frames_is_refused_with_both():
    with pytest.raises(ControlError, match="'map' and 'odom'") as refused:
        follow_goal(goal("map", "map", "odom", "map"))
    assert refused.value.outcome is ControlOutcome.INVALID_PATH
