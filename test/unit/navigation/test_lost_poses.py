"""Poses that do not come while the robot drives, as from a robot out of reach of its radio: it stands, and waits."""

import pytest
import scripted
from scripted import FORWARD, arrive

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FollowGoal, FramedPose, NavigateGoal, NavigateOutcome
from mbf_relay.outcomes import ControlOutcome, PlanOutcome

PATH = scripted.straight_path()
GOAL = NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "map"))


def test_a_lost_pose_is_waited_for_then_named(bench):
    bench.script.velocity = Twist2D(0.01, 0.0, 0.0)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    for tick in range(31):  # lost now and then, it is no reason to give up
        bench.robot.lost = "" if tick % 5 else "the odometry is late"
        bench.step()
        assert not task.done
    bench.robot.lost = None
    bench.step()
    bench.robot.lost = "the transform from 'base' to 'odom' is 2.1 s old"
    bench.step()
    assert bench.robot.sent[-1] == STOP and not task.done
    result = bench.finish(task)
    assert result.outcome is ControlOutcome.TF_ERROR and "2.1 s old" in result.message


@pytest.mark.parametrize("parameters, patience, name", [
    ({"controller_patience": 5.0}, 5.0, "controller_patience"),
    ({"controller_patience": 5.0, "tf_timeout": 2.0}, 2.0, "tf_timeout")])
def test_a_robot_out_of_reach_of_its_radio_for_seconds_stands_and_drives_on(make_bench, parameters, patience, name):
    """Its goal was ended after one second, where under move_base it waited as long as for a velocity."""
    bench = make_bench(**parameters)
    for outage, is_over in ((patience - 0.3, False), (patience + 0.3, True)):
        task = bench.navigator.exe_path(FollowGoal(PATH))
        bench.step()
        bench.robot.lost = "the transform from 'base' to 'odom' is 2.1 s old"
        for _ in range(round(outage / 0.1)):
            bench.step()
        assert bench.robot.sent[-1] == STOP and task.done is is_over
        assert bench.robot.waits_for == ("" if is_over else "the transform from 'base' to 'odom' is 2.1 s old")
        bench.robot.lost = None
        bench.step()
        assert is_over or bench.robot.sent[-1] == FORWARD and not bench.robot.waits_for
        task.cancel()
        result = bench.finish(task)
        assert result.outcome is (ControlOutcome.TF_ERROR if is_over else ControlOutcome.CANCELED)
    assert f"for {patience:g} s ({name}): the transform from 'base' to 'odom' is 2.1 s old" in result.message


@pytest.mark.parametrize("parameters, patience", [
    ({"planner_patience": 5.0}, 5.0), ({"planner_patience": 1.0}, 3.0), ({"planner_patience": 0.0}, 3.0),
    ({"planner_patience": 5.0, "tf_timeout": 2.0}, 2.0)])
def test_a_goal_that_comes_while_the_robot_is_out_of_reach_of_its_radio_is_driven_to(make_bench, parameters, patience):
    """It was refused after three seconds, where move_base tries for as long as for a path."""
    bench = make_bench(recovery_enabled=False, **parameters)
    arrive(bench)
    for outage, outcome in ((patience - 0.3, NavigateOutcome.SUCCESS), (patience + 0.3, PlanOutcome.TF_ERROR)):
        bench.robot.pose, bench.robot.lost = Pose2D(0.0, 0.0, 0.0), "the transform from 'base' to 'odom' is 2.1 s old"
        task = bench.navigator.move_base(GOAL)
        for _ in range(round(outage / 0.1)):
            bench.step()
        bench.robot.lost = None
        assert bench.finish(task).outcome is outcome


@pytest.mark.parametrize("whole", [False, True])
def test_a_robot_that_waited_for_its_radio_is_not_said_to_oscillate(make_bench, whole):
    """It was given up, or recovered with all it had, as soon as it saw where it was again."""
    bench = make_bench(controller_patience=10.0, oscillation_timeout=3.0, oscillation_distance=0.5)
    bench.script.velocity = Twist2D(0.1, 0.0, 0.0)
    task = bench.navigator.move_base(GOAL) if whole else bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(10):
        bench.step()
    bench.robot.lost = "the transform from 'base' to 'odom' is 2.1 s old"
    for _ in range(50):
        bench.step()
    bench.robot.lost = None
    for _ in range(15):
        bench.step()
    assert not task.done and not {"R1", "R2"} & set(bench.script.calls)
    assert bench.robot.sent[-1] == bench.script.velocity


@pytest.mark.parametrize("whole", [False, True])
def test_a_robot_that_gets_nowhere_between_two_waits_is_said_to(make_bench, whole):
    bench = make_bench(controller_patience=10.0, oscillation_timeout=3.0, recovery_enabled=False)
    bench.script.velocity = Twist2D(0.0001, 0.0, 0.0)
    task = bench.navigator.move_base(GOAL) if whole else bench.navigator.exe_path(FollowGoal(PATH))
    for tick in range(55):
        bench.robot.lost = None if tick // 10 % 2 == 0 else "the transform from 'base' to 'odom' is 2.1 s old"
        bench.step()
        assert not task.done, tick
    bench.robot.lost = None
    for _ in range(8):
        bench.step()
    assert task.result.outcome in (ControlOutcome.OSCILLATION, NavigateOutcome.OSCILLATION)
