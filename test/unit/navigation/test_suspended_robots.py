"""Robots whose computer is suspended in the middle of a drive, as by its lid, and wakes with old data."""

import pytest
import scripted
from scripted import FORWARD, GOAL, STOP

from mbf_relay.geometry import Twist2D
from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.outcomes import ControlOutcome


def sleep(bench, seconds):
    """Let the computer sleep, with the robot standing meanwhile, and wake for a cycle with costmaps as old."""
    bench.now += seconds
    bench.costmaps["local"].stale = f"{seconds:.1f} s old"
    bench.navigator.update(bench.now)
    bench.costmaps["local"].stale = None


@pytest.mark.parametrize("oscillation_timeout", [0.0, 10.0])
def test_a_robot_whose_computer_slept_goes_on_to_its_goal_without_a_recovery(make_bench, oscillation_timeout):
    """Its patience of a few seconds was over when it woke: costmaps were cleared, or its goal had ended."""
    bench = make_bench(oscillation_timeout=oscillation_timeout)
    scripted.arrive(bench)
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.2)
    sleep(bench, 45.0)
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS and "R1" not in bench.script.calls


@pytest.mark.filterwarnings("ignore:.*drives slower:RuntimeWarning")
def test_a_robot_that_wakes_does_not_drive_by_what_was_computed_before(make_bench):
    bench = make_bench(scripted.HeldWorker(), controller_patience=5.0)
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.1)
    bench.worker.delays = [None]
    for _ in range(5):
        bench.step()
    bench.script.velocity = Twist2D(0.15, 0.0, 0.7)
    bench.worker.release()
    bench.script.velocity = FORWARD
    bench.now += 45.0
    bench.navigator.update(bench.now)
    sent = len(bench.robot.sent)
    bench.run(lambda: any(told.x > 0.0 for told in bench.robot.sent[sent:]))
    assert not task.done and all(told.theta == 0.0 for told in bench.robot.sent)


@pytest.mark.parametrize("period", [1.2, 3.0])
def test_a_robot_whose_computer_wakes_for_a_moment_now_and_then_stands_and_its_goal_ends(make_bench, period):
    """It was told nothing any more: it drove on with its last velocity for good, and no patience ended its goal."""
    bench = make_bench(
        scripted.HeldWorker(), controller_patience=5.0, planner_frequency=0.0, oscillation_timeout=0.0,
        recovery_enabled=False)
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.1)
    bench.step(period)
    assert bench.robot.sent[-1] == STOP and not task.done
    bench.run(lambda: task.done, 400.0, period)
    assert task.result.outcome is ControlOutcome.PAT_EXCEEDED and bench.robot.sent[-1] == STOP
