"""Drives by controllers whose cycles take long, or hang."""

import numpy as np
import pytest
import scripted
from scripted import FORWARD

from mbf_relay.geometry import STOP
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.outcomes import ControlOutcome

PATH = scripted.straight_path()


def test_a_controller_that_hangs_lets_the_robot_stand_and_ends_with_patience(held_bench):
    bench = held_bench
    bench.worker.delays = [1, 1, None]
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.run(lambda: bench.robot.sent[-1:] == [FORWARD])
    bench.run(lambda: bench.robot.sent[-1] == STOP, 1.0)
    assert not task.done and bench.navigator.due > bench.now, "nobody spins while it hangs"
    assert bench.finish(task, 2.0).outcome is ControlOutcome.PAT_EXCEEDED
    second = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    assert bench.robot.sent[-1] == STOP and not second.done
    bench.worker.release()
    bench.run(lambda: bench.robot.sent[-1] == FORWARD, 1.0)


def test_a_robot_does_not_set_off_by_what_its_controller_saw_before_it_hung(make_bench):
    """Somebody may have stepped in front of it meanwhile; it drove a cycle's way before it looked again."""
    bench = make_bench(scripted.HeldWorker(), controller_patience=5.0)
    bench.worker.delays = [1, 1, 15]
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.run(lambda: bench.robot.sent[-1:] == [STOP], 2.0)
    sent = len(bench.robot.sent)
    bench.run(lambda: any("computed for" in told.message for told in task.take_feedback()), 3.0)
    assert set(bench.robot.sent[sent:]) <= {STOP}
    bench.run(lambda: bench.robot.sent[-1] == FORWARD, 1.0)


def test_a_path_that_came_while_the_controller_thought_is_taken_up_the_moment_it_returns(held_bench):
    bench = held_bench
    bench.worker.delays = [2, 1]
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.step(0.0)
    newer = scripted.straight_path()
    bench.navigator.exe_path(FollowGoal(newer))
    bench.step(0.02)  # the controller is still at the old path
    bench.step(0.02)  # it returns
    bench.step(0.02)  # what it thought of the new path is there: no cycle was waited for
    assert [path for path, _ in bench.script.paths] == [PATH, newer] and bench.robot.sent == [FORWARD]


def drive_with_cycles_of(bench, seconds, count):
    """Drive for so many cycles of a controller that takes so long, and return the speeds that were commanded."""
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    before = len(bench.robot.sent)
    while len(bench.robot.sent) < before + count:
        bench.step(seconds)
    return bench.robot.sent


def test_a_robot_whose_computer_falls_behind_drives_slower_and_says_so_once(held_bench):
    with pytest.warns(RuntimeWarning, match=r"computes for \d+% of its 0\.10 s period; the robot drives") as said:
        sent = drive_with_cycles_of(held_bench, 0.1, 40)  # as long as the period
    assert len(said) == 1
    assert sent[0] == FORWARD and sent[-1].x == pytest.approx(0.7 * FORWARD.x, rel=0.01)


def test_a_robot_whose_computer_keeps_up_is_not_slowed(held_bench):
    assert set(drive_with_cycles_of(held_bench, 0.05, 40)) == {FORWARD}


def slow_drive(make_bench, monkeypatch):
    """Let a robot follow a path, by a controller that computes for 0.8 s a cycle; return its bench and task."""
    bench = make_bench(
        scripted.HeldWorker(), controller_patience=5.0, C1={"max_vel_x": 0.22, "max_vel_trans": 0.22},
        controllers=[{"name": "C1", "type": "regulated_pure_pursuit"}])
    bench.worker.delays = [8] * 100
    for costmap in bench.costmaps.values():
        costmap.footprint = 0.1 * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    command = bench.robot.command

    def told(velocity):
        bench.robot.delay.tell(bench.now, velocity)
        command(velocity)

    monkeypatch.setattr(bench.robot, "command", told)
    return bench, bench.navigator.exe_path(FollowGoal(PATH))


@pytest.mark.filterwarnings("ignore:.*drives slower:RuntimeWarning")
def test_a_robot_that_creeps_as_its_busy_computer_tells_it_is_not_taken_for_stuck(make_bench, monkeypatch):
    """Its goal was aborted: of the 0.22 m/s asked for, the wheels were told a tenth, and to stand most of the time."""
    bench, task = slow_drive(make_bench, monkeypatch)
    bench.run(lambda: task.done or bench.robot.pose.x > 0.4, 60.0)
    assert not task.done, task.result.message


@pytest.mark.filterwarnings("ignore:.*drives slower:RuntimeWarning")
def test_one_whose_wheels_stand_meanwhile_is_stuck(make_bench, monkeypatch):
    bench, task = slow_drive(make_bench, monkeypatch)
    bench.robot.held = True
    assert bench.finish(task).outcome is ControlOutcome.ROBOT_STUCK
    assert "has not moved for" in task.result.message
