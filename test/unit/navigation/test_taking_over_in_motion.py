"""What moves the robot when another controller, or another goal, takes over."""

import pytest
import scripted
from scripted import FORWARD, GOAL, NO_WAY, STUCK

from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.navigation.goals import FollowGoal, FramedPose, NavigateGoal
from mbf_relay.navigation.task import Ending

PATH = scripted.straight_path()


@pytest.mark.parametrize("stop", [
    lambda bench: None, lambda bench: setattr(bench.robot, "paused", True)], ids=["its first call hangs", "paused"])
def test_a_robot_that_another_controller_takes_over_in_motion_does_not_drive_on_unattended(held_bench, stop):
    bench = held_bench
    bench.navigator.exe_path(FollowGoal(PATH, controller="C1"))
    bench.step()
    bench.step()
    assert bench.robot.sent[-1] == FORWARD
    bench.worker.delays = [None]
    bench.navigator.exe_path(FollowGoal(PATH, controller="C2"))
    stop(bench)
    for _ in range(6):
        bench.step()
    assert bench.robot.sent[-1] == STOP


def test_a_goal_metres_away_is_another_goal_also_in_utm_coordinates(bench):
    """What a controller had reached of the first one counted for the next, half a metre or 50 m away."""
    for y in (5.1e6, 5.1e6 + 0.5, 5.1e6 + 5.0):
        bench.navigator.exe_path(FollowGoal(scripted.straight_path(end_y=y)))
        bench.step()
        bench.step(0.0)
    assert [new for _path, new in bench.script.paths] == [True, True, True]


def test_what_a_recovery_drives_ends_where_another_goal_takes_over(make_bench):
    """The robot drove on as the behaviour had said last, until the new goal had a path."""
    worker = scripted.HeldWorker()
    bench = make_bench(worker, planner_max_retries=0)
    bench.script.plan, bench.script.recovery = NO_WAY, lambda context: iter([FORWARD] * 100)
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.sent[-1:] == [FORWARD])
    worker.delays = [None, None]
    bench.navigator.move_base(GOAL)
    bench.step(0.01)
    assert task.ending is Ending.CANCELED and bench.robot.sent[-1] == STOP
    worker.release()
    bench.step()
    assert bench.script.cleaned_up == 1


@pytest.mark.parametrize("limit", [
    {"controller_patience": 1.0}, {"controller_patience": 0.0, "controller_max_retries": 9}], ids=["patience", "tries"])
def test_a_robot_sent_elsewhere_while_its_controller_finds_no_way_has_the_whole_patience_for_the_new_goal(
        make_bench, limit):
    """It gave the new goal up at its first cycle, for what the controller had failed at before."""
    bench = make_bench(recovery_enabled=False, **limit)
    bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.velocity = STUCK
    for _ in range(8):
        bench.step()
    task, sent_at = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(-2.0, 0.0, 0.0), "map"))), bench.now
    bench.finish(task)
    assert bench.now - sent_at == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_robot_sent_on_is_not_said_to_be_near_its_new_goal_for_having_been_near_the_last_one(held_bench, stuck):
    """Its clients were told the last goal's distance until the new one had a path and a control cycle."""
    bench = held_bench
    bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.9)
    bench.worker.delays = [5]
    task = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(3.0, 0.0, 0.0), "map")))
    if stuck:
        bench.robot.stale = "no odometry"
    told = []
    for _ in range(12):
        bench.step(0.05)
        told += [feedback.distance for feedback in task.take_feedback()]
    assert told and min(told) > 1.5


def test_a_client_whose_new_path_is_not_begun_is_not_told_how_far_the_end_of_the_last_one_was(bench):
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.run(lambda: bench.robot.pose.x > 0.9)
    bench.robot.stale = "no odometry"
    task = bench.navigator.exe_path(FollowGoal(scripted.straight_path(3.0)))
    bench.step()
    task.cancel()
    bench.step()
    assert min(told.distance for told in task.take_feedback()) > 1.5 and task.result.distance > 1.5
