"""move_base: planning, driving, replanning, recovering, and being called off at any of them."""

import itertools

import numpy as np
import pytest
import scripted
from scripted import FORWARD

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FollowGoal, FramedPose, NavigateGoal, NavigateOutcome, PlanGoal
from mbf_relay.navigation.move_base import path_is_blocked
from mbf_relay.navigation.remedies import VERDICTS
from mbf_relay.navigation.task import Ending
from mbf_relay.navigation.trials import Trials
from mbf_relay.navigation.way_keeper import WayKeeper, is_same_way
from mbf_relay.outcomes import ControlError, ControlOutcome, PlanningError, PlanOutcome, RecoveryOutcome
from mbf_relay.planning.path import Path

GOAL = NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "map"))
NO_WAY = PlanningError(PlanOutcome.NO_PATH_FOUND, "walls all around")
STUCK = ControlError(ControlOutcome.NO_VALID_CMD, "all trajectories hit something")


def arrive(bench, x=0.95):
    bench.script.reached = lambda state: bench.robot.pose.x >= x


def bowed_path(height, length=1.0):
    """A path along x with a bow to one side."""
    xs = np.linspace(0.0, length, 11)
    return Path(np.column_stack((xs, height * np.sin(np.pi * xs / length), np.zeros(11))), "map")


def failing(error, times, otherwise):
    """A script's entry that raises `times` times."""
    left = [times]

    def run(*arguments):
        if left[0] > 0:
            left[0] -= 1
            raise error
        return otherwise(*arguments) if callable(otherwise) else otherwise

    return run


def test_it_plans_and_drives(bench):
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    result = bench.finish(task)
    assert result.outcome is NavigateOutcome.SUCCESS and task.ending is Ending.SUCCEEDED
    assert bench.script.calls["plan"] == 1 and bench.robot.sent[-1] == STOP
    assert result.pose.pose.x == pytest.approx(0.96, abs=0.02) and result.distance == pytest.approx(0.04, abs=0.02)


def test_the_first_velocity_comes_with_the_path(held_bench):
    bench = held_bench
    bench.navigator.move_base(GOAL)
    bench.navigator.update(bench.now)
    bench.step(0.003)
    bench.step(0.003)
    assert bench.robot.sent == [FORWARD]


def test_every_control_cycle_is_reported(bench):
    task = bench.navigator.move_base(GOAL)
    for _ in range(20):
        bench.step()
    assert len(task.take_feedback()) == pytest.approx(20, abs=1)


def test_it_replans_while_driving_and_keeps_what_was_reached(make_bench):
    bench = make_bench(scripted.HeldWorker(), planner_frequency=5.0)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    bench.finish(task)
    assert task.ending is Ending.SUCCEEDED
    assert 15 <= bench.script.calls["plan"] <= 26
    assert [new for _path, new in bench.script.paths].count(True) == 1
    assert STOP not in bench.robot.sent[:-1]


def test_it_does_not_replan_right_at_the_goal(make_bench):
    bench = make_bench(planner_frequency=10.0)
    bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.95)
    bench.script.velocity = STOP
    calls = bench.script.calls["plan"]
    for _ in range(20):
        bench.step()
    assert bench.script.calls["plan"] == calls


def test_a_failed_replan_is_reported_and_the_last_path_kept(make_bench):
    bench = make_bench(planner_frequency=5.0)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = NO_WAY
    task.take_feedback()
    bench.step()
    bench.step()
    bench.step()
    assert any("replanning failed" in report.message and "walls" in report.message for report in task.take_feedback())
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS
    assert STOP not in bench.robot.sent[:-1]


def test_a_failed_replan_over_a_blocked_path_stops_and_recovers(make_bench):
    bench = make_bench(planner_frequency=5.0)
    task = bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = NO_WAY
    bench.costmaps["global"].costs[100, 115] = 254
    bench.script.recovery = lambda context: (STOP for _ in range(5))
    bench.run(lambda: bench.script.calls.get("R1"), 2.0)
    count = len(bench.robot.sent)
    for _ in range(4):
        bench.step()
    assert set(bench.robot.sent[count:]) == {STOP}
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.PAT_EXCEEDED and bench.script.calls["R2"] == 1


def test_only_what_lies_ahead_blocks_a_path():
    costmap = scripted.PaperCostmap("map")
    poses = scripted.straight_path().poses
    costmap.costs[100, 104] = 254
    assert path_is_blocked(costmap.snapshot(), poses, Pose2D(0.0, 0.0, 0.0))
    assert not path_is_blocked(costmap.snapshot(), poses, Pose2D(0.5, 0.1, 0.0))
    assert not path_is_blocked(costmap.snapshot(), poses + np.array([50.0, 0.0, 0.0]), None)


# one way or another

WAYS = {side: bowed_path(side * 0.4) for side in (-1, 1)}


@pytest.fixture
def flipping_bench(make_bench):
    """A robot 0.2 m wide whose replans lead alternately round two sides."""
    bench = make_bench(planner_frequency=10.0)
    sides = itertools.cycle([1, 1, -1])
    bench.script.plan = lambda start, goal: WAYS[next(sides)]
    bench.script.velocity = Twist2D(0.02, 0.0, 0.0)
    return bench


def sides_taken(bench):
    return [1 if path.poses[5, 1] > 0.0 else -1 for path, _new in bench.script.paths]


def test_replans_that_flip_between_two_ways_do_not_turn_the_robot(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    for _ in range(50):
        flipping_bench.step()
    assert len(sides_taken(flipping_bench)) > 20 and set(sides_taken(flipping_bench)) == {1}


def test_a_way_found_again_and_again_is_taken(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    flipping_bench.step()
    flipping_bench.script.plan = lambda start, goal: WAYS[-1]
    count = len(flipping_bench.script.paths)
    for _ in range(9):
        flipping_bench.step()
    taken = sides_taken(flipping_bench)[count:]
    assert taken and set(taken) == {-1}


def test_another_way_is_taken_at_once_where_the_last_is_blocked(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    flipping_bench.step()
    x, y = WAYS[1].poses[5, :2]
    column, row = flipping_bench.costmaps["global"].snapshot().grid.cell_at(x, y)
    flipping_bench.costmaps["global"].costs[row, column] = 254
    flipping_bench.script.plan = lambda start, goal: WAYS[-1]
    flipping_bench.step()
    flipping_bench.step()
    assert sides_taken(flipping_bench)[-1] == -1


def test_after_a_recovery_any_way_is_taken(flipping_bench):
    bench = flipping_bench
    bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = lambda start, goal: WAYS[-1]
    bench.script.velocity = failing(ControlError(ControlOutcome.BLOCKED_GOAL, "a chair"), 1, FORWARD)
    bench.run(lambda: bench.script.calls.get("R1"))
    bench.step()
    assert sides_taken(bench)[-1] == -1


def test_each_change_near_the_last_takes_longer():
    keeper, robot, changes = WayKeeper(), Pose2D(0.0, 0.0, 0.0), []
    side, now = 1, 0.0
    for step in range(200):
        now = 0.1 * step
        if keeper.wants(now, WAYS[side].poses, WAYS[-side].poses, robot, 0.2):
            side = -side
            changes.append(now)
    waits = np.diff(changes)
    assert len(changes) >= 4 and (waits[1:] > 1.5 * waits[:-1]).all()
    keeper.restart()
    elsewhere = Pose2D(1.0, 0.0, 0.0)
    assert not keeper.wants(now + 1.0, WAYS[side].poses, WAYS[-side].poses, elsewhere, 0.2)
    assert keeper.wants(now + 2.0, WAYS[side].poses, WAYS[-side].poses, elsewhere, 0.2)


def test_a_robot_off_its_path_takes_any():
    assert WayKeeper().wants(0.0, WAYS[1].poses, WAYS[-1].poses, Pose2D(0.5, -0.4, 0.0), 0.2)


def test_ways_are_the_same_up_to_the_robots_width():
    assert is_same_way(bowed_path(0.4).poses, bowed_path(0.25).poses, 0.2)
    assert not is_same_way(bowed_path(0.4).poses, bowed_path(0.15).poses, 0.2)
    longer = np.vstack((bowed_path(0.4).poses, [[6.0, 0.0, 0.0]]))
    assert not is_same_way(bowed_path(0.4).poses, longer, 0.2)  # it leads on past where the other one ends
    assert is_same_way(np.zeros((1, 3)), np.array([[0.0, 0.1, 0.0]]), 0.2)


def test_planning_that_fails_is_recovered_from(make_bench):
    bench = make_bench(planner_max_retries=0)
    arrive(bench)
    bench.script.plan = failing(NO_WAY, 1, scripted.line)
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is NavigateOutcome.SUCCESS
    assert bench.script.calls["R1"] == 1 and "R2" not in bench.script.calls


def test_when_nothing_is_left_to_try_the_planner_s_outcome_is_passed_on(make_bench):
    bench = make_bench(planner_max_retries=0)
    bench.script.plan = NO_WAY
    task = bench.navigator.move_base(GOAL)
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.NO_PATH_FOUND and task.ending is Ending.ABORTED
    assert bench.script.calls == {**bench.script.calls, "plan": 3, "R1": 1, "R2": 1}


def test_the_goal_s_own_recoveries_are_tried_in_its_order(make_bench):
    bench = make_bench(planner_max_retries=0)
    bench.script.plan = NO_WAY
    order = []
    bench.script.recovery = lambda context: order.append(len(order)) or iter(())
    bench.finish(bench.navigator.move_base(NavigateGoal(GOAL.target, recovery_behaviors=("R2", "R1", "R2"))))
    assert bench.script.calls["R1"] == 1 and bench.script.calls["R2"] == 2


def test_recovery_can_be_switched_off(make_bench):
    bench = make_bench(planner_max_retries=0, recovery_enabled=False)
    bench.script.plan = NO_WAY
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is PlanOutcome.NO_PATH_FOUND
    assert "R1" not in bench.script.calls


def test_a_drive_that_fails_is_recovered_from_and_everything_tried_again(make_bench):
    bench = make_bench(controller_max_retries=0)
    arrive(bench)
    bench.script.velocity = failing(STUCK, 2, FORWARD)
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is NavigateOutcome.SUCCESS
    assert bench.script.calls["plan"] == 3 and bench.script.calls["R1"] == bench.script.calls["R2"] == 1


def test_recoveries_that_fail_lead_to_the_next_ones(make_bench):
    bench = make_bench(controller_max_retries=0)
    bench.script.velocity = STUCK

    def breaks(context):
        raise RuntimeError("motor gone")

    bench.script.recovery = breaks
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is ControlOutcome.NO_VALID_CMD
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1


def test_a_path_alone_does_not_start_the_recoveries_over(make_bench):
    bench = make_bench(planner_max_retries=0, controller_max_retries=0)
    failures = itertools.cycle([NO_WAY, None])

    def plan(start, goal):
        failure = next(failures)
        if failure:
            raise failure
        return scripted.line(start, goal)

    bench.script.plan, bench.script.velocity = plan, STUCK
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is PlanOutcome.NO_PATH_FOUND
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1


@pytest.mark.parametrize("trouble", ["planning", "driving", "oscillation"])
def test_recoveries_start_over_once_the_robot_has_got_elsewhere(make_bench, trouble):
    bench = make_bench(
        planner_max_retries=0, controller_max_retries=0, planner_frequency=10.0, oscillation_distance=0.3,
        oscillation_timeout=3.0)
    told = []
    bench.navigator.recovery_watcher = lambda name, index, total, where: told.append((round(where.pose.x, 1), name))
    arrive(bench)

    def hinder(state=None):  # at 0.2 m, once more there, and at 0.7 m
        due = bench.robot.pose.x > (0.15 if len(told) < 2 else 0.65) and len(told) < 3
        if due and trouble == "driving":
            raise STUCK
        return STOP if due and trouble == "oscillation" else FORWARD

    def plan(start, goal):
        if start.x > (0.15 if len(told) < 2 else 0.65) and len(told) < 3 and trouble == "planning":
            bench.costmaps["global"].costs[100, 115:] = 254  # or it would go on along the last path
            raise NO_WAY
        bench.costmaps["global"].costs[:] = 0
        return scripted.line(start, goal)

    bench.script.velocity, bench.script.plan = hinder, plan
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is NavigateOutcome.SUCCESS
    assert told == [(0.2, "R1"), (0.2, "R2"), (0.7, "R1")]


def test_back_at_a_place_recoveries_go_on_where_they_were():
    trials = Trials(["a", "b"])
    here, there = Pose2D(0.0, 0.0, 0.0), Pose2D(0.5, 0.0, 1.0)
    assert [trials.next(pose, 0.3, bool) for pose in (here, there, None, here, there, here, None)] == [
        0, 0, 1, 1, None, None, None]


def test_what_does_not_suit_is_kept_for_later():
    trials = Trials(["a", "b", "c"])
    assert [trials.next(None, 0.0, "ac".__contains__), trials.next(None, 0.0, bool)] == [0, 1]


# which failures are recovered from

OUTCOMES = [outcome for kind in (PlanOutcome, ControlOutcome) for outcome in kind if outcome.name != "SUCCESS"]
FINAL = {
    *(PlanOutcome[name] for name in (
        "CANCELED", "INVALID_START", "INVALID_GOAL", "TF_ERROR", "NOT_INITIALIZED", "INVALID_PLUGIN", "INTERNAL_ERROR",
        "OUT_OF_MAP", "MAP_ERROR", "STOPPED")),
    *(ControlOutcome[name] for name in (
        "CANCELED", "INVALID_PATH", "TF_ERROR", "NOT_INITIALIZED", "INVALID_PLUGIN", "INTERNAL_ERROR", "MAP_ERROR",
        "STOPPED")),
}
STAYING = {PlanOutcome.BLOCKED_GOAL, PlanOutcome.PAT_EXCEEDED}
PLACES = [{"name": "R1", "type": "scripted.ScriptedRecovery"}, {"name": "R2", "type": "scripted.LeavingRecovery"}]


def test_every_outcome_is_judged_and_has_a_reason():
    assert set(VERDICTS) == {*OUTCOMES, NavigateOutcome.OSCILLATION}
    assert all(len(verdict.reason) > 10 for verdict in VERDICTS.values())


@pytest.mark.parametrize("patience", [0.0, 0.5], ids=["no retries", "until patience ends"])
@pytest.mark.parametrize("outcome", OUTCOMES, ids=lambda outcome: f"{type(outcome).__name__}.{outcome.name}")
def test_only_what_a_recovery_can_change_is_recovered_from(make_bench, outcome, patience):
    retries = -1 if patience else 0
    bench = make_bench(
        planner_max_retries=retries, controller_max_retries=retries, planner_patience=patience,
        controller_patience=patience, recovery_behaviors=PLACES)
    if isinstance(outcome, PlanOutcome):
        bench.script.plan = PlanningError(outcome, "for a reason")
    else:
        bench.script.velocity = ControlError(outcome, "for a reason")
    task = bench.navigator.move_base(GOAL)
    result = bench.finish(task)
    ran = [name for name in ("R1", "R2") if name in bench.script.calls]
    assert ran == ([] if outcome in FINAL else ["R1"] if outcome in STAYING else ["R1", "R2"])
    assert task.ending is Ending.ABORTED and "for a reason" in result.message
    assert result.outcome is outcome or (patience and result.outcome is type(outcome).PAT_EXCEEDED)
    if outcome in FINAL and not patience:
        assert result.message == "for a reason" and bench.robot.pose == Pose2D(0.0, 0.0, 0.0)


def test_a_goal_in_an_unknown_frame_ends_without_a_move(make_bench):
    bench = make_bench(tf_timeout=0.5, recovery_behaviors=PLACES)
    bench.script.recovery = lambda context: iter([Twist2D(-0.1, 0.0, 0.0)] * 5)
    task = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "atlantis")))
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.TF_ERROR and "atlantis" in result.message
    assert not {"R1", "R2"} & set(bench.script.calls) and bench.robot.pose == Pose2D(0.0, 0.0, 0.0)


def test_a_transform_that_comes_late_is_no_failure(make_bench):
    bench = make_bench(tf_timeout=0.5)
    arrive(bench)
    bench.robot.lost = "map and odom are not related yet"
    task = bench.navigator.move_base(GOAL)
    for _ in range(3):
        bench.step()
    bench.robot.lost = None
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS and "R1" not in bench.script.calls


def test_oscillation_is_recovered_from_and_named_at_last(make_bench):
    bench = make_bench(oscillation_timeout=1.0, oscillation_distance=0.3, controller_patience=0.0)
    bench.script.velocity = Twist2D(0.01, 0.0, 0.0)
    task = bench.navigator.move_base(GOAL)
    result = bench.finish(task)
    assert result.outcome is NavigateOutcome.OSCILLATION and "oscillating" in result.message
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1


def test_progress_after_oscillation_gives_the_recoveries_back(make_bench):
    bench = make_bench(oscillation_timeout=1.0, oscillation_distance=0.1)
    arrive(bench)
    bench.script.velocity = Twist2D(0.01, 0.0, 0.0)
    task = bench.navigator.move_base(GOAL)
    for _ in range(2):
        ran = bench.script.calls.get("R1", 0)
        bench.run(lambda: bench.script.calls.get("R1", 0) > ran)
        bench.script.velocity = FORWARD
        x = bench.robot.pose.x
        bench.run(lambda: bench.robot.pose.x > x + 0.15)
        bench.script.velocity = Twist2D(0.01, 0.0, 0.0)
    assert "R2" not in bench.script.calls and not task.done


def test_a_new_goal_takes_over_without_a_stop(held_bench):
    bench = held_bench
    first = bench.navigator.move_base(GOAL)
    bench.run(lambda: len(bench.robot.sent) > 3)
    second = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    assert first.ending is Ending.CANCELED
    arrive(bench, 1.9)
    assert bench.finish(second).outcome is NavigateOutcome.SUCCESS
    assert STOP not in bench.robot.sent[:-1]
    assert [new for _path, new in bench.script.paths] == [True, True]


def test_a_new_goal_without_a_path_stops_the_old_drive(make_bench):
    bench = make_bench(planner_max_retries=0, recovery_enabled=False)
    bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = NO_WAY
    second = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    assert bench.finish(second).outcome is PlanOutcome.NO_PATH_FOUND
    assert bench.robot.sent[-1] == STOP


def test_five_hundred_goals_one_after_the_other(held_bench):
    bench = held_bench
    arrive(bench)
    tasks = []
    for index in range(500):
        tasks.append(bench.navigator.move_base(GOAL))
        if index % 3 == 0:
            bench.step(0.02)
            bench.robot.pose = Pose2D(0.0, 0.0, 0.0)
    assert bench.finish(tasks[-1]).outcome is NavigateOutcome.SUCCESS
    assert all(task.ending is Ending.CANCELED for task in tasks[:-1])


@pytest.mark.parametrize("steps", range(12))
def test_a_cancel_ends_it_at_any_step(make_bench, steps):
    bench = make_bench(scripted.HeldWorker(), planner_frequency=5.0, controller_max_retries=0)
    bench.script.velocity = failing(STUCK, 1, FORWARD)
    bench.script.recovery = lambda context: (Twist2D(0.0, 0.0, 0.5) for _ in range(3))
    task = bench.navigator.move_base(GOAL)
    for _ in range(steps):
        bench.step()
    task.cancel()
    bench.step(0.001)
    assert task.ending is Ending.CANCELED and task.result.outcome is NavigateOutcome.CANCELED
    sent = list(bench.robot.sent)
    for _ in range(20):
        bench.step()
    assert bench.robot.sent == sent and sent[-1:] in ([], [STOP])
    assert bench.navigator.idle and bench.navigator.due == float("inf")


def test_another_client_s_path_takes_the_controller_and_ends_the_goal(bench):
    task = bench.navigator.move_base(GOAL)
    bench.step()
    other = bench.navigator.exe_path(FollowGoal(scripted.straight_path(3.0)))
    bench.step()
    assert task.ending is Ending.CANCELED and "taken off" in task.result.message
    assert not other.done and bench.robot.sent[-1] == FORWARD


def test_plans_of_other_clients_do_not_disturb_it(make_bench):
    bench = make_bench(scripted.HeldWorker(), planner_frequency=5.0)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    for _ in range(10):
        bench.navigator.get_path(PlanGoal(FramedPose(Pose2D(0.0, 3.0, 0.0), "map")))
        bench.step()
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


@pytest.mark.parametrize("goal, outcome", [
    (NavigateGoal(GOAL.target, planner="A*"), PlanOutcome.INVALID_PLUGIN),
    (NavigateGoal(GOAL.target, controller="teb"), ControlOutcome.INVALID_PLUGIN),
    (NavigateGoal(GOAL.target, recovery_behaviors=("R1", "dance")), RecoveryOutcome.INVALID_PLUGIN),
])
def test_unknown_plugins_are_rejected_at_once_and_disturb_nothing(bench, goal, outcome):
    running = bench.navigator.move_base(GOAL)
    bench.step()
    task = bench.navigator.move_base(goal)
    assert task.ending is Ending.REJECTED and task.result.outcome is outcome
    bench.step()
    assert not running.done


def test_nothing_is_due_in_the_past_also_near_the_goal(make_bench):
    bench = make_bench(planner_frequency=5.0)
    arrive(bench, x=0.99)
    task = bench.navigator.move_base(GOAL)
    while not task.done:
        bench.step()
        bench.navigator.update(bench.now)
        assert bench.navigator.due > bench.now - 1e-6, f"at x {bench.robot.pose.x:.3f}"
    assert task.ending is Ending.SUCCEEDED
