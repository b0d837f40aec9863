"""A filter that starts again in the middle of a drive: where the robot has got meanwhile, and when odometry cannot say.
"""

import math

import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.kept_pose import KeptPose, kept_pose_from

KEPT = KeptPose(Pose2D(1.0, 2.0, math.pi / 2.0), Pose2D(5.0, 5.0, 0.0), 100.0)
AHEAD = Pose2D(5.4, 5.0, 0.0)
"""What odometry says after 0.4 m straight on."""
THERE = Pose2D(1.0, 2.4, math.pi / 2.0)


def fits(there, here=0.0):
    return lambda pose: here if pose == KEPT.pose else there


@pytest.mark.parametrize("fit", [fits(0.9), fits(0.6, 0.7), fits(0.3, 0.2), fits(None), fits(0.0, None)])
def test_a_robot_that_drove_on_while_its_filter_was_dead_is_where_odometry_leads(fit):
    pose, sentence = KEPT.resume(AHEAD, 102.0, fit)
    assert pose.distance_to(THERE) < 1e-9 and pose.theta == pytest.approx(THERE.theta)
    assert "2.0 s ago" in sentence and "0.40 m" in sentence


@pytest.mark.parametrize("fit", [fits(0.1, 0.9), fits(0.0, 0.0), fits(0.49, 0.49)])
def test_a_robot_whose_odometry_began_anew_is_not_sent_where_that_leads(fit):
    pose, sentence = KEPT.resume(Pose2D(0.0, 0.0, 0.0), 102.0, fit)
    assert pose == KEPT.pose and "began anew" in sentence


def test_a_robot_whose_clock_began_anew_is_where_it_was():
    pose, sentence = KEPT.resume(AHEAD, 3.0, fits(0.9))
    assert pose == KEPT.pose and "97.0 s" in sentence


def test_what_was_kept_comes_back_to_the_last_bit():
    kept = KeptPose(Pose2D(0.1, 0.2, 0.3), Pose2D(1 / 3, 2 / 3, -1 / 3), 1e9 / 7)
    assert kept_pose_from(kept.as_parameters(), kept.pose) == kept


@pytest.mark.parametrize("value", [
    None, 3, "x", [1.0], {}, {"x": 1.0}, {**KEPT.as_parameters(), "a": "x"}, {**KEPT.as_parameters(), "y": math.nan},
    {**KEPT.as_parameters(), "stamp": True}, {**KEPT.as_parameters(), "x": {"y": 1.0}},
])
def test_what_is_broken_or_half_there_is_not_used(value):
    assert kept_pose_from(value, KEPT.pose) is None


def test_a_launch_file_that_says_where_the_robot_is_overrules_the_last_run():
    assert kept_pose_from(KEPT.as_parameters(), Pose2D(1.0, 2.0, 0.0)) is None
