"""Paths that clients send in other frames than the map's: the robot's own moves with it, odometry's stands."""

import math

import pytest
import scripted

from mbf_relay.geometry import Pose2D
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.outcomes import ControlOutcome


def test_a_path_in_the_robot_s_own_frame_does_not_run_ahead_of_it(make_bench):
    """Sent half a metre ahead, a robot drove on for as long as nothing stood in its way."""
    bench = make_bench(mbf_tolerance_check=True, dist_tolerance=0.06)
    bench.robot.pose = Pose2D(2.0, 1.0, math.pi / 2)
    result = bench.finish(bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0, "base"))))
    assert result.outcome is ControlOutcome.SUCCESS
    assert bench.robot.pose.distance_to(Pose2D(2.0, 2.0, math.pi / 2)) < 0.06


def test_the_same_way_ahead_sent_again_on_the_way_is_another_goal(bench):
    bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0, "base")))
    bench.step()
    bench.step()
    bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0, "base")))
    bench.step()
    assert [new for _path, new in bench.script.paths] == [True, True]
    first, second = (path.goal.x for path, _new in bench.script.paths)
    assert second - first == pytest.approx(0.04)


def test_a_path_in_odometry_s_frame_stays_there(bench):
    """Localization may correct itself on the way; who drives by odometry is not to jump with it."""
    bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0, "odom")))
    bench.step()
    assert [path.frame for path, _new in bench.script.paths] == ["odom"]
