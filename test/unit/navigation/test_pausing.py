"""A drive that is paused stands, keeps its goal however long that lasts, and goes on."""

import pytest
import scripted
from scripted import FORWARD, GOAL, NO_WAY, STUCK, arrive, straight_path

from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.navigation.controller_execution import PAUSED
from mbf_relay.navigation.goals import FollowGoal, NavigateOutcome, RecoverGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import ControlOutcome


def wait(bench, seconds):
    for _ in range(int(seconds / 0.1)):
        bench.step()


def test_a_paused_drive_stands_at_once_for_as_long_as_it_takes_and_then_arrives(make_bench):
    bench = make_bench(oscillation_timeout=3.0, controller_patience=1.0, planner_frequency=0.0)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    wait(bench, 2.0)
    assert bench.robot.sent[-1] == FORWARD
    bench.robot.paused = True
    bench.step(0.01)
    assert bench.robot.sent[-1] == STOP
    task.take_feedback()
    sent, where = len(bench.robot.sent), bench.robot.pose
    wait(bench, 60.0)
    assert bench.robot.pose == where and len(bench.robot.sent) == sent, "nothing is sent that a stick would fight with"
    assert not task.done and {each.message for each in task.take_feedback()} == {PAUSED}
    bench.robot.paused = False
    bench.step()
    assert bench.robot.sent[-1] == FORWARD
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


def test_a_velocity_thought_of_before_the_pause_is_not_sent_in_it_nor_after(held_bench):
    bench = held_bench
    task = bench.navigator.exe_path(FollowGoal(straight_path()))
    bench.navigator.update(bench.now)
    bench.robot.paused = True
    for _ in range(5):
        bench.step()
    assert FORWARD not in bench.robot.sent and not task.done
    bench.worker.delays = [3]
    bench.robot.paused = False
    bench.step()
    bench.robot.paused = True
    bench.navigator.update(bench.now)
    bench.script.velocity = scripted.Twist2D(0.1, 0.0, 0.0)
    bench.robot.paused = False
    for _ in range(5):
        bench.step()
    assert FORWARD not in bench.robot.sent and bench.robot.sent[-1] == bench.script.velocity


def test_a_recovery_s_velocity_thought_of_before_a_short_pause_is_not_sent_after_it(held_bench):
    bench = held_bench
    bench.script.recovery = lambda context: iter([FORWARD, scripted.Twist2D(0.1, 0.0, 0.0)])
    bench.navigator.recovery(RecoverGoal("R2"))
    bench.navigator.update(bench.now)
    bench.robot.paused = True
    bench.step()
    bench.robot.paused = False
    for _ in range(5):
        bench.step()
    assert FORWARD not in bench.robot.sent and scripted.Twist2D(0.1, 0.0, 0.0) in bench.robot.sent


def test_a_paused_drive_is_cancelled_as_any_other(bench):
    task = bench.navigator.move_base(GOAL)
    wait(bench, 1.0)
    bench.robot.paused = True
    wait(bench, 1.0)
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent[-1] == STOP


@pytest.mark.parametrize("trouble, outcome", [
    ("no way on", ControlOutcome.PAT_EXCEEDED), ("no pose", ControlOutcome.TF_ERROR),
    ("no motion", ControlOutcome.ROBOT_STUCK), ("no progress", ControlOutcome.OSCILLATION)])
def test_the_time_of_a_pause_is_held_against_nobody(make_bench, trouble, outcome):
    """A drive in some trouble before its pause, or after it, was given up with its first cycle."""
    bench = make_bench(oscillation_timeout=3.0, cmd_vel_ignored_tolerance=2.0)
    task = bench.navigator.exe_path(FollowGoal(straight_path()))
    wait(bench, 0.5)
    if trouble == "no way on":
        bench.script.velocity = STUCK
    elif trouble == "no pose":
        bench.robot.lost = "no transform"
    elif trouble == "no motion":
        bench.robot.held = True
    else:
        bench.script.velocity = STOP
    for paused, seconds in ((False, 0.5), (True, 60.0), (False, 0.5)):
        bench.robot.paused = paused
        wait(bench, seconds)
        assert not task.done
    assert bench.finish(task).outcome is outcome


def test_a_pause_is_told_of_at_the_controller_s_rate(bench):
    task = bench.navigator.exe_path(FollowGoal(straight_path()))
    bench.robot.paused = True
    for _ in range(100):
        bench.step(0.01)
    assert 10 <= len(task.take_feedback()) <= 11


def test_a_goal_that_comes_in_a_pause_waits_for_its_end(bench):
    bench.robot.paused = True
    task = bench.navigator.move_base(GOAL)
    wait(bench, 5.0)
    assert FORWARD not in bench.robot.sent and not task.done
    bench.robot.paused = False
    wait(bench, 0.5)
    assert bench.robot.sent[-1] == FORWARD


def test_a_paused_recovery_stands_and_goes_on_where_it_was(make_bench):
    bench = make_bench(planner_max_retries=0, recovery_patience=2.0)
    bench.script.plan = NO_WAY
    done = []

    def eight_steps(context):
        for _ in range(8):
            yield FORWARD
        done.append(context.now)

    bench.script.recovery = eight_steps
    task = bench.navigator.move_base(GOAL)
    wait(bench, 0.4)
    assert bench.robot.sent[-1] == FORWARD
    bench.robot.paused = True
    bench.step()
    assert bench.robot.sent[-1] == STOP
    before, sent = bench.script.calls.get("R2", 0), len(bench.robot.sent)
    wait(bench, 30.0)
    assert bench.script.calls.get("R2", 0) == before and not task.done and not done
    assert len(bench.robot.sent) == sent, "nothing is sent that a stick would fight with"
    assert bench.navigator.due > bench.now, "nobody spins while it waits"
    bench.robot.paused = False
    bench.script.plan = scripted.line
    wait(bench, 2.0)
    assert bench.robot.sent[-1] == FORWARD and not task.done and len(done) == 1


def test_a_robot_moved_by_hand_in_a_pause_drives_on_from_where_it_is(make_bench):
    bench = make_bench(planner_frequency=2.0)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    wait(bench, 1.0)
    bench.robot.paused = True
    wait(bench, 1.0)
    bench.robot.pose = Pose2D(-1.0, 0.5, 0.0)
    wait(bench, 1.0)
    bench.robot.paused = False
    wait(bench, 1.0)
    assert bench.script.paths[-1][0].poses[0][0] == pytest.approx(-1.0, abs=0.2)
    assert not task.done
