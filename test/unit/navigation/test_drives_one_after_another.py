"""What one drive leaves to the next, and what a controller's failures, hangs and new paths do in between."""

import pytest
import scripted
from scripted import FORWARD, STUCK, failing

from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import ControlOutcome

PATH = scripted.straight_path()


def test_a_robot_whose_new_goal_is_planned_twice_before_it_sets_out_is_told_of_a_new_goal(bench):
    """Its controller would have taken the goal for the last one's, which was reached."""
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    bench.robot.lost = "no transform"  # for a moment: the first path is not begun
    bench.navigator.exe_path(FollowGoal(scripted.straight_path(2.0)))
    bench.step()
    bench.robot.lost = None
    newest = scripted.straight_path(2.0)
    bench.navigator.exe_path(FollowGoal(newest))
    bench.run(lambda: len(bench.script.paths) == 2, 1.0)
    assert bench.script.paths[-1] == (newest, True)


def test_a_controller_is_not_asked_again_where_a_drive_ends_as_its_next_cycle_is_due(held_bench):
    """A velocity would have followed the zero."""
    bench = held_bench
    bench.script.reached = True
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    bench.step(0.3)  # the answer, and the next cycle's time
    assert task.ending is Ending.SUCCEEDED
    for _ in range(3):
        bench.step()
    assert bench.script.calls["reached"] == 1 and bench.robot.sent == [STOP]


def test_a_controller_still_in_a_call_of_the_last_drive_is_waited_for_and_taken_up_the_moment_it_returns(make_bench):
    bench = make_bench(scripted.HeldWorker(), controller_patience=3.0)
    bench.worker.delays = [None]
    first = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    first.cancel()
    bench.step()
    task = bench.navigator.exe_path(FollowGoal(scripted.straight_path(2.0)))
    for _ in range(5):
        bench.step()
    assert "still busy with an earlier call" in bench.robot.waits_for and bench.robot.sent[-1] == STOP
    assert all("still busy" in told.message for told in task.take_feedback())
    bench.step(0.05)
    bench.worker.release()
    bench.step(0.02)
    bench.step(0.02)
    assert bench.robot.sent[-1] == FORWARD and len(bench.script.paths) == 2, "one call of each drive"


def test_a_robot_whose_controller_may_hang_for_ever_stands_and_drives_on(make_bench):
    bench = make_bench(scripted.HeldWorker(), controller_patience=0.0)
    bench.worker.delays = [1, None]
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.run(lambda: bench.robot.sent == [FORWARD, STOP], 2.0)
    for _ in range(100):
        bench.step()
    assert not task.done
    bench.worker.release()
    bench.run(lambda: bench.robot.sent[-1] == FORWARD, 1.0)


def test_a_client_is_told_where_the_robot_is_in_the_map_also_of_a_path_in_odometry_s_frame(bench, monkeypatch):
    odom_from_map = Pose2D(-3.0, 1.0, 0.5)
    pose_in = bench.robot.pose_in
    monkeypatch.setattr(
        bench.robot, "pose_in",
        lambda frame: odom_from_map.compose(pose_in(frame)) if frame == "odom" else pose_in(frame))
    task = bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0, "odom")))
    bench.step()
    told = task.take_feedback()[-1].pose
    assert told.frame == "map" and told.pose == pytest.approx((0.0, 0.0, 0.0))


def test_a_robot_with_one_retry_has_one(make_bench):
    bench = make_bench(controller_max_retries=1, controller_patience=0.0)
    bench.script.velocity = STUCK
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.NO_VALID_CMD and bench.script.calls["velocity"] == 2


def test_a_robot_that_got_on_has_all_its_retries_again(make_bench):
    bench = make_bench(controller_max_retries=2, controller_patience=0.0)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(3):
        bench.script.velocity = failing(STUCK, 2, FORWARD)
        for _ in range(3):
            bench.step()
        assert not task.done and bench.robot.sent[-1] == FORWARD


@pytest.mark.parametrize("stops, sent", [(True, STOP), (False, FORWARD.scaled(0.5))])
def test_a_robot_whose_controller_fails_once_stands_or_slows_down_as_it_is_told_to(make_bench, stops, sent):
    bench = make_bench(force_stop_on_retry=stops)
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    assert bench.robot.sent[-1] == FORWARD
    bench.script.velocity = STUCK
    bench.step()
    assert bench.robot.sent[-1] == sent


def test_a_robot_that_is_stuck_and_oscillates_by_one_cycle_ends_its_drive_once(make_bench):
    bench = make_bench(cmd_vel_ignored_tolerance=1.0, oscillation_timeout=1.0)
    bench.robot.held = True
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)), 10.0)
    assert result.outcome is ControlOutcome.ROBOT_STUCK
