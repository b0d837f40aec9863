"""Drives: cycles, retries, patience, blindness, replacing, cancelling; and a zero velocity last, whatever happens."""

import math

import numpy as np
import pytest
import scripted
from scripted import FORWARD, STUCK, arrive

from mbf_relay.control.state import GoalTolerance
from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import ControlError, ControlOutcome

PATH = scripted.straight_path()


def test_a_drive_ends_at_the_goal_with_a_zero(bench):
    arrive(bench, 0.95)
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.SUCCESS and result.distance == pytest.approx(0.04, abs=0.02)
    assert bench.robot.sent[:-1] == [FORWARD] * (len(bench.robot.sent) - 1) and bench.robot.sent[-1] == STOP
    assert result.pose.frame == "map"


def test_every_cycle_is_reported_at_its_rate(bench):
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    for _ in range(100):
        bench.step(0.02)
    reports = task.take_feedback()
    assert len(reports) == pytest.approx(21, abs=1) == len(bench.robot.sent)
    assert all(report.outcome is ControlOutcome.SUCCESS and report.velocity == FORWARD for report in reports)
    assert reports[-1].distance < reports[0].distance


def test_cycles_that_were_missed_are_not_made_up_for(bench):
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    bench.step(0.35)
    bench.step(0.01)
    bench.step(0.01)
    assert len(bench.robot.sent) == 2


def test_a_velocity_thought_of_before_the_cancel_is_not_sent_after_it(held_bench):
    bench = held_bench
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    sent = list(bench.robot.sent)
    task.cancel()
    bench.step()
    bench.step()
    assert task.ending is Ending.CANCELED
    assert bench.robot.sent == sent + [STOP]


def test_a_controller_is_told_what_was_sent_last_also_by_the_end_of_another_drive(bench):
    told = []
    bench.script.reached = lambda state: told.append(state.commanded)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    bench.step()
    task.cancel()
    bench.step()
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    assert told == [None, FORWARD, STOP]


def test_a_cancel_during_the_very_call_wins(bench):
    task = bench.navigator.exe_path(FollowGoal(PATH))

    def cancel_meanwhile(state):
        task.cancel()
        return FORWARD

    bench.script.velocity = cancel_meanwhile
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent == [STOP]


def test_a_goal_cancelled_before_its_first_cycle_moves_nothing(bench):
    task = bench.navigator.exe_path(FollowGoal(PATH))
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent == [STOP]


@pytest.mark.parametrize("retries, cycles", [(0, 1), (2, 3)])
def test_failed_cycles_are_counted(make_bench, retries, cycles):
    bench = make_bench(controller_max_retries=retries, controller_patience=0.0)
    bench.script.velocity = STUCK
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.NO_VALID_CMD and bench.script.calls["velocity"] == cycles


def test_failed_cycles_end_with_patience(bench):
    bench.script.velocity = STUCK
    started = bench.now
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    assert [report.message for report in task.take_feedback()] == ["all trajectories hit something"]
    result = bench.finish(task)
    assert result.outcome is ControlOutcome.PAT_EXCEEDED and "all trajectories" in result.message
    assert 1.0 < bench.now - started < 1.4
    assert set(bench.robot.sent) == {STOP}


def test_patience_and_tries_count_from_the_last_velocity(make_bench):
    bench = make_bench(controller_max_retries=8)
    answers = iter([STUCK, STUCK, STUCK, STUCK, STUCK, STUCK, STUCK, FORWARD] * 5 + [FORWARD] * 100)

    def sometimes(state):
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    bench.script.velocity = sometimes
    arrive(bench, 0.9)
    assert bench.finish(bench.navigator.exe_path(FollowGoal(PATH))).outcome is ControlOutcome.SUCCESS


def test_without_force_stop_on_retry_the_robot_slows_down(make_bench):
    bench = make_bench(force_stop_on_retry=False)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    bench.script.velocity = STUCK
    for _ in range(8):
        bench.step()
    speeds = [velocity.x for velocity in bench.robot.sent[1:]]
    assert speeds[0] == pytest.approx(0.1) and speeds == sorted(speeds, reverse=True) and speeds[-1] == 0.0
    assert not task.done


@pytest.mark.parametrize("outcome", [
    ControlOutcome.ROBOT_STUCK, ControlOutcome.BLOCKED_GOAL, ControlOutcome.MISSED_PATH, ControlOutcome.INVALID_PATH,
])
def test_what_no_retry_can_change_ends_the_drive_at_once(make_bench, outcome):
    bench = make_bench(controller_max_retries=-1, controller_patience=0.0)
    bench.script.velocity = ControlError(outcome, "for a reason")
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is outcome and result.message == "for a reason" and bench.script.calls["velocity"] == 1


@pytest.mark.parametrize("answer, outcome, text", [
    (RuntimeError("index 7"), ControlOutcome.INTERNAL_ERROR, "RuntimeError: index 7"),
    (None, ControlOutcome.INTERNAL_ERROR, "None is no velocity"),
    ("fast", ControlOutcome.INTERNAL_ERROR, "'fast' is no velocity"),
    ((0.1, 0.0), ControlOutcome.INTERNAL_ERROR, "(0.1, 0.0) is no velocity"),
    (Twist2D("0.1", 0.0, 0.0), ControlOutcome.INTERNAL_ERROR, "controller 'C1' failed"),
    (Twist2D(np.array([0.1]), 0.0, 0.0), ControlOutcome.INTERNAL_ERROR, "controller 'C1' failed"),
    (Twist2D(math.nan, 0.0, 0.0), ControlOutcome.PAT_EXCEEDED, "(nan, 0.0, 0.0), which no robot drives"),
    (Twist2D(0.0, 0.0, math.inf), ControlOutcome.PAT_EXCEEDED, "(0.0, 0.0, inf), which no robot drives"),
    (Twist2D(1e9, 0.0, 0.0), ControlOutcome.PAT_EXCEEDED, "(1000000000.0, 0.0, 0.0), which no robot drives"),
])
def test_a_controller_that_misbehaves_ends_its_goal_and_no_more(bench, answer, outcome, text):
    bench.script.velocity = answer
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is outcome and text in result.message
    assert set(bench.robot.sent) == {STOP}
    bench.script.velocity = FORWARD
    arrive(bench, 0.9)
    assert bench.finish(bench.navigator.exe_path(FollowGoal(PATH))).outcome is ControlOutcome.SUCCESS


@pytest.mark.parametrize("blind, text", [
    (lambda bench: setattr(bench.robot, "stale", "odometry is 3 s old"), "odometry is 3 s old"),
    (lambda bench: setattr(bench.costmaps["local"], "stale", "source 'scan' is 3 s old"), "source 'scan' is 3 s old"),
])
def test_nobody_drives_on_stale_data(bench, blind, text):
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    assert bench.robot.sent == [FORWARD]
    blind(bench)
    bench.step()
    assert bench.robot.sent[-1] == STOP and task.take_feedback()[-1].message == text
    result = bench.finish(task)
    assert result.outcome is ControlOutcome.PAT_EXCEEDED and text in result.message
    assert set(bench.robot.sent[1:]) == {STOP}


def test_data_that_comes_back_lets_the_robot_go_on(bench):
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.costmaps["local"].stale = "no scan yet"
    bench.step(0.5)
    bench.costmaps["local"].stale = None
    bench.step()
    assert bench.robot.sent[-1] == FORWARD and not task.done


def test_a_new_path_for_the_running_controller_takes_over_without_a_stop(bench):
    first = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    second = bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0)))
    third = bench.navigator.exe_path(FollowGoal(scripted.straight_path(2.0)))
    bench.step(0.0)
    assert first.ending is second.ending is Ending.CANCELED and not third.done
    assert first.result.message == "Goal preempted by a new plan"
    assert bench.robot.sent == [FORWARD, FORWARD]
    assert [new for _path, new in bench.script.paths] == [True, True]


def test_a_new_path_to_the_same_goal_is_no_new_goal_and_brings_no_cycle_of_its_own(bench):
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0)))
    bench.step(0.0)
    assert len(bench.robot.sent) == 1
    bench.step()
    bench.step(0.0)
    assert [new for _path, new in bench.script.paths] == [True, False] and len(bench.robot.sent) == 2


def test_what_a_controller_thought_of_the_old_path_does_not_end_the_new_one(held_bench):
    bench = held_bench
    bench.script.reached = lambda state: bench.script.paths[-1][0].goal.x < 1.5
    first = bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    second = bench.navigator.exe_path(FollowGoal(scripted.straight_path(2.0)))
    bench.step()
    bench.step()
    assert first.ending is Ending.CANCELED and not second.done


def test_another_controller_takes_over_without_a_stop(bench):
    first = bench.navigator.exe_path(FollowGoal(PATH, controller="C1"))
    bench.step()
    bench.navigator.exe_path(FollowGoal(PATH, controller="C2"))
    bench.step(0.0)
    assert first.ending is Ending.CANCELED and bench.robot.sent == [FORWARD, FORWARD]


def test_with_force_stop_on_cancel_it_stops_first(make_bench):
    bench = make_bench(force_stop_on_cancel=True)
    bench.navigator.exe_path(FollowGoal(PATH, controller="C1"))
    bench.step()
    bench.navigator.exe_path(FollowGoal(PATH, controller="C2"))
    bench.step(0.0)
    assert bench.robot.sent == [FORWARD, STOP, FORWARD]


def test_an_unknown_controller_and_an_empty_path_are_refused_without_disturbing_the_drive(bench):
    running = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    unknown = bench.navigator.exe_path(FollowGoal(PATH, controller="teb"))
    empty = bench.navigator.exe_path(FollowGoal(scripted.Path(PATH.poses[:0], "map")))
    assert unknown.ending is Ending.REJECTED and unknown.result.outcome is ControlOutcome.INVALID_PLUGIN
    assert empty.ending is Ending.ABORTED and empty.result.outcome is ControlOutcome.INVALID_PATH
    bench.step()
    assert not running.done and bench.robot.sent == [FORWARD, FORWARD]


def test_the_server_judges_arrival_where_asked_to(make_bench):
    bench = make_bench(mbf_tolerance_check=True)
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.SUCCESS and result.distance == pytest.approx(0.09, abs=0.02)
    bench.robot.pose = Pose2D(0.0, 0.0, 0.0)
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH, tolerance=GoalTolerance(0.5, 0.2))))
    assert result.distance == pytest.approx(0.49, abs=0.02)
    for side in (-1.0, 1.0):
        bench.robot.pose = Pose2D(1.0, 0.0, side)
        bench.script.velocity = Twist2D(0.0, 0.0, -0.5 * side)
        result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH, tolerance=GoalTolerance(0.1, 0.2))))
        assert result.angle == pytest.approx(0.175, abs=0.03), "turned away from the goal's heading, to either side"


def test_a_robot_that_ignores_its_commands_is_stuck(bench):
    bench.robot.held = True
    started = bench.now
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.ROBOT_STUCK and bench.now - started == pytest.approx(5.1, abs=0.3)


def test_a_controller_is_told_how_late_the_wheels_are_and_where_the_robot_is_until_they_hear(bench, monkeypatch):
    states, sent = [], bench.robot.sent

    def command(velocity):
        bench.robot.delay.tell(bench.now, velocity)
        sent.append(velocity)

    def velocity(state):
        states.append(state)
        return Twist2D(0.2 if len(states) % 16 < 8 else 0.05, 0.0, 0.0)

    def move(seconds):  # by what was told half a second ago
        bench.robot.reported = sent[-6] if len(sent) > 5 else STOP
        bench.robot.pose = bench.robot.pose.compose(bench.robot.reported.held(seconds))

    monkeypatch.setattr(bench.robot, "command", command)
    monkeypatch.setattr(bench.robot, "move", move)
    bench.script.velocity = velocity
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.run(lambda: len(states) > 50)
    told = states[-1]
    assert told.delay == pytest.approx(0.5, abs=0.11)
    assert told.pose_now == bench.robot.pose and told.pose.x > told.pose_now.x + 0.02


@pytest.mark.parametrize("outcome", [ControlOutcome.ROBOT_STUCK, ControlOutcome.BLOCKED_GOAL])
def test_a_robot_whose_guard_or_driver_is_gone_is_not_sent_to_look_at_its_wheels(bench, outcome):
    bench.script.velocity = ControlError(outcome, "it has not moved")
    bench.robot.silence = "nobody listens to /cmd_vel_raw"
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    why = "nobody listens to /cmd_vel_raw: " if outcome is ControlOutcome.ROBOT_STUCK else ""
    assert result.message == f"{why}it has not moved"


def test_who_drives_against_the_guard_is_told_what_the_guard_sees(bench, monkeypatch):
    bench.script.velocity = ControlError(ControlOutcome.ROBOT_STUCK, "it has not moved")
    bench.robot.objection = "velocity_guard says 'stopped: a foot'"
    # which has nothing against a robot that is to stand
    monkeypatch.setattr(bench.robot, "command", lambda velocity: setattr(bench.robot, "objection", ""))
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.message == "velocity_guard says 'stopped: a foot': it has not moved"


def test_oscillation_is_noticed(make_bench):
    bench = make_bench(oscillation_timeout=2.0, oscillation_distance=0.3)
    bench.script.velocity = lambda state: Twist2D(0.2 if math.sin(5.0 * bench.now) > 0.0 else -0.2, 0.0, 0.0)
    result = bench.finish(bench.navigator.exe_path(FollowGoal(PATH)))
    assert result.outcome is ControlOutcome.OSCILLATION


def test_turning_on_the_spot_is_progress(make_bench):
    bench = make_bench(oscillation_timeout=2.0, oscillation_distance=0.3)
    bench.script.velocity = Twist2D(0.0, 0.0, 1.7)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(100):
        bench.step()
    assert not task.done


@pytest.mark.parametrize("timeout, rate, turns_back, gives_up", [
    (10.0, 0.1, 0.0, False), (10.0, 0.3, 0.0, False), (3.0, 0.2, 0.0, False), (10.0, 0.3, 3.0, True),
    (10.0, 0.1, 15.0, True), (10.0, 0.01, 0.0, True),
])
def test_a_robot_slow_to_turn_that_turns_one_way_does_not_oscillate(make_bench, timeout, rate, turns_back, gives_up):
    """At 0.3 rad/s no robot turns by 3.14 rad in 10 s; it was given up while it turned to its goal's heading."""
    bench = make_bench(oscillation_timeout=timeout, oscillation_distance=0.2)
    bench.script.velocity = lambda state: Twist2D(
        0.0, 0.0, -rate if turns_back and bench.now % (2.0 * turns_back) > turns_back else rate)
    task = bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(260):
        bench.step()
    assert task.done == gives_up


def test_new_rates_hold_from_the_next_cycle_on(bench):
    bench.navigator.exe_path(FollowGoal(PATH))
    bench.navigator.update(bench.now)
    bench.navigator.reconfigure(bench.navigator.parameters.replace(controller_frequency=50.0))
    for _ in range(55):
        bench.step(0.02)
    assert len(bench.robot.sent) == pytest.approx(52, abs=2)


def test_two_slots_drive_with_controllers_of_their_own(bench):
    tasks = [bench.navigator.exe_path(FollowGoal(scripted.straight_path(1.0 + slot), slot=slot)) for slot in (0, 255)]
    bench.step()
    tasks[1].cancel()
    bench.step()
    assert not tasks[0].done and tasks[1].ending is Ending.CANCELED


def test_the_clock_may_jump_back(bench):
    task = bench.navigator.exe_path(FollowGoal(PATH))
    bench.step()
    bench.now = 5.0
    bench.step(0.0)
    bench.step()
    assert bench.robot.sent == [FORWARD] * 3 and not task.done


def test_a_zone_s_limit_reaches_the_controller_of_every_drive_and_is_lifted_behind_it(bench):
    limits = []
    controller = bench.navigator.controllers.instance("C1", 0).plugin
    controller.limit_speed = lambda limit, source: limits.append((limit.share, source))
    task = bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(5):
        bench.step()
    bench.costmaps["global"].zone_limit = ZoneLimit(share=0.5)
    for _ in range(5):
        bench.step()
    task.cancel()
    for _ in range(5):
        bench.step()
    bench.costmaps["global"].zone_limit = ZoneLimit()
    bench.navigator.exe_path(FollowGoal(PATH))
    for _ in range(5):
        bench.step()
    assert limits == [(1.0, "zone"), (0.5, "zone"), (1.0, "zone")]
