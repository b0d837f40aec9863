"""What becomes of a path whose poses have no rotation, as of clients who fill in positions alone."""

import math

import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from mbf_msgs.msg import ExePathGoal

from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.ros.server.messages import follow_goal

UNSET, TURNED = Quaternion(), Quaternion(0.0, 0.0, math.sin(0.5), math.cos(0.5))


def path_goal(*poses):
    goal = ExePathGoal()
    goal.path.header.frame_id = "map"
    for x, y, rotation in poses:
        goal.path.poses.append(PoseStamped(pose=Pose(Point(x, y, 0.0), rotation)))
    return goal


def test_a_path_of_which_only_the_end_has_a_rotation_is_driven_along():
    path = follow_goal(path_goal((0, 0, UNSET), (1, 0, TURNED), (2, 0, UNSET), (2, -1, TURNED))).path
    assert path.poses[:, 2] == pytest.approx([0.0, 1.0, -math.pi / 2.0, 1.0])


def test_a_path_whose_end_has_no_rotation_is_refused_since_nobody_knows_how_the_robot_is_to_stand():
    with pytest.raises(ControlError, match=r"pose 1 of the path: quaternion \(0.0, 0.0, 0.0, 0.0\)") as caught:
        follow_goal(path_goal((0, 0, UNSET), (1, 0, UNSET)))
    assert caught.value.outcome is ControlOutcome.INVALID_PATH


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_path_without_rotations_with_a_place_that_is_no_number_is_refused(lost):
    poses = [(float(n), 0.0, UNSET) for n in range(2)] + [(2.0, 0.0, TURNED)]
    poses[lost] = (math.nan, 0.0, poses[lost][2])
    with pytest.raises(ControlError, match=f"pose {lost} of the path"):
        follow_goal(path_goal(*poses))
