"""What move_base recovers from, with which behaviours, and when it starts them over."""

import itertools
from types import SimpleNamespace

import pytest
import scripted
from scripted import FORWARD, GOAL, NO_WAY, STUCK, arrive, failing

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FramedPose, NavigateGoal, NavigateOutcome
from mbf_relay.navigation.recovery_policy import BY_SEEING, POLICIES, TriedBehaviors, can_change
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import ControlError, ControlOutcome, PlanningError, PlanOutcome


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
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is ControlOutcome.NO_VALID_CMD
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1
    assert "recovery behaviour 'R2' failed with RuntimeError: motor gone (scripted.py, line" in result.message, (
        "whoever wrote it would look for the fault in the planner")


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
    bench.navigator.recovery_watcher = lambda name, _index, _total, at, _why: told.append((round(at.pose.x, 1), name))
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
    trials = TriedBehaviors(["a", "b"])
    here, there = Pose2D(0.0, 0.0, 0.0), Pose2D(0.5, 0.0, 1.0)
    assert [trials.next(pose, 0.3, bool) for pose in (here, there, None, here, there, here, None)] == [
        0, 0, 1, 1, None, None, None]


def test_where_the_robot_is_not_known_recoveries_go_on_as_at_the_last_failure():
    """They went on as at the place that was come to last for the first time, and tried again what had been in vain."""
    trials, (here, there) = TriedBehaviors(["a", "b", "c"]), (Pose2D(0.0, 0.0, 0.0), Pose2D(5.0, 0.0, 0.0))
    assert [trials.next(pose, 0.3, bool) for pose in (here, there, here, None, None)] == [0, 0, 1, 2, None]


def test_what_does_not_suit_is_kept_for_later():
    trials = TriedBehaviors(["a", "b", "c"])
    assert [trials.next(None, 0.0, "ac".__contains__), trials.next(None, 0.0, bool)] == [0, 1]


def test_what_was_tried_without_odometry_is_tried_again_once_with_it():
    trials = TriedBehaviors(["a", "b"])
    certain = [True, False, False, False, True, True, True]
    assert [trials.next(None, 0.0, bool, each) for each in certain] == [0, 1, None, None, 0, 1, None]


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
    assert set(POLICIES) == {*OUTCOMES, NavigateOutcome.OSCILLATION}
    assert all(len(verdict.reason) > 10 for verdict in POLICIES.values())


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


@pytest.mark.parametrize("sees_all_round", [True, False])
@pytest.mark.parametrize("trouble", ["plan", "velocity"])
def test_a_robot_that_sees_all_round_does_not_turn_round_where_no_path_is_found(make_bench, trouble, sees_all_round):
    looking = [{"name": "R1", "type": "scripted.LookingRecovery"}, {"name": "R2", "type": "scripted.LeavingRecovery"}]
    bench = make_bench(planner_max_retries=0, controller_max_retries=0, recovery_behaviors=looking)
    bench.costmaps["global"].sees_all_round = sees_all_round
    setattr(bench.script, trouble, NO_WAY if trouble == "plan" else STUCK)
    bench.finish(bench.navigator.move_base(GOAL))
    assert ("R1" in bench.script.calls) is (trouble == "velocity" or not sees_all_round)
    assert bench.script.calls["R2"] == 1


def test_a_goal_in_an_unknown_frame_ends_without_a_move(make_bench):
    bench = make_bench(tf_timeout=0.5, recovery_behaviors=PLACES)
    bench.script.recovery = lambda context: iter([Twist2D(-0.1, 0.0, 0.0)] * 5)
    task = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "atlantis")))
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.TF_ERROR and "atlantis" in result.message
    assert not {"R1", "R2"} & set(bench.script.calls) and bench.robot.pose == Pose2D(0.0, 0.0, 0.0)


@pytest.mark.parametrize("silence, tried", [("nobody listens to /cmd_vel_raw", 0), ("", 1)])
def test_a_client_is_told_that_nobody_moves_the_wheels_without_recoveries_that_nobody_carries_out(
        make_bench, silence, tried):
    bench = make_bench(cmd_vel_ignored_tolerance=1.0)
    bench.script.velocity = FORWARD
    bench.robot.silence, bench.robot.held = silence, True
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is ControlOutcome.ROBOT_STUCK and silence in result.message
    assert bench.script.calls.get("R1", 0) == tried


def test_a_robot_whose_wheels_stop_between_its_commands_is_not_said_to_stand(make_bench):
    """By a controller of 1 Hz and wheels that heed a command for half a second it stood at each look, and was given up.
    """
    bench = make_bench(cmd_vel_ignored_tolerance=1.0)
    arrive(bench)
    bench.robot.reported = STOP
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is NavigateOutcome.SUCCESS


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
    assert "the last one is 0.01 m/s" in result.message
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1


@pytest.mark.parametrize("trouble", ["oscillation", "a blocked path"])
def test_a_robot_is_told_to_stand_before_it_begins_to_recover(make_bench, trouble):
    """It drove on as its controller had said last, for a step of navigation more."""
    bench = make_bench(planner_frequency=5.0, oscillation_timeout=2.0, oscillation_distance=0.3)
    to_and_fro = itertools.cycle([FORWARD, Twist2D(-0.2, 0.0, 0.0)])
    bench.script.velocity = lambda state: next(to_and_fro)
    last = []
    bench.navigator.recovery_watcher = lambda *_: last.append(bench.robot.sent[-1])
    bench.navigator.move_base(GOAL)
    bench.step()
    if trouble == "a blocked path":
        bench.script.plan, bench.costmaps["global"].costs[100, 115] = NO_WAY, 254
    assert bench.run(lambda: last) == [STOP]


def test_who_asks_why_a_robot_oscillated_is_told_what_the_controller_said_last(make_bench):
    bench = make_bench(
        oscillation_timeout=1.0, oscillation_distance=0.3, controller_patience=0.0, recovery_enabled=False)
    bench.script.velocity = ControlError(ControlOutcome.BLOCKED_PATH, "a box stands on the path")
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is NavigateOutcome.OSCILLATION
    assert result.message.endswith("the controller last said BLOCKED_PATH: a box stands on the path")


def test_who_asks_why_a_robot_oscillated_is_told_that_its_wheels_hear_late(make_bench):
    bench = make_bench(
        oscillation_timeout=1.0, oscillation_distance=0.3, controller_patience=0.0, recovery_enabled=False)
    bench.script.velocity, bench.robot.delay.seconds = Twist2D(0.01, 0.0, 0.0), 0.4
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is NavigateOutcome.OSCILLATION
    assert "it moves as it was told 0.40 s before, so commands reach its wheels late; no velocity" in result.message


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


@pytest.mark.parametrize("plan, drive, words", [
    (NO_WAY, FORWARD, "planner 'P1': NO_PATH_FOUND: "), (None, STUCK, "controller 'C1': NO_VALID_CMD: "),
])
def test_who_reads_the_log_learns_why_the_robot_recovers(make_bench, plan, drive, words):
    bench = make_bench(planner_max_retries=0, controller_max_retries=0)
    told = []
    bench.navigator.recovery_watcher = lambda name, index, total, where, why: told.append(why)
    bench.script.plan, bench.script.velocity = plan or scripted.line, drive
    bench.finish(bench.navigator.move_base(GOAL))
    assert told and all(why.startswith(words) and len(why) > len(words) for why in told)


def test_a_robot_wider_than_every_gap_is_told_so_after_one_wait_for_a_path_not_one_after_each_recovery(make_bench):
    bench = make_bench(planner_patience=5.0)
    bench.script.plan = NO_WAY
    result = bench.finish(bench.navigator.move_base(GOAL))
    assert result.outcome is PlanOutcome.NO_PATH_FOUND and result.message == NO_WAY.message
    assert bench.script.calls["R1"] == bench.script.calls["R2"] == 1
    assert bench.now < 1007.0


def test_who_stands_in_a_doorway_has_the_time_of_one_patience_to_leave_it(make_bench):
    bench = make_bench(planner_patience=5.0)
    arrive(bench)
    bench.script.plan = failing(NO_WAY, 20, scripted.line)  # five times a second
    assert bench.finish(bench.navigator.move_base(GOAL)).outcome is NavigateOutcome.SUCCESS
    assert "R1" not in bench.script.calls


@pytest.mark.parametrize("patience, retries", [(5.0, -1), (0.0, 50)])
@pytest.mark.parametrize("refused, outcome", [(10000, PlanOutcome.NO_PATH_FOUND), (20, NavigateOutcome.SUCCESS)])
def test_a_goal_behind_what_the_planner_finds_a_way_through_now_and_then_ends(
    make_bench, refused, outcome, patience, retries
):
    """It went on for ever: each path found gave the controller, which drove none, all patience and retries again."""
    bench = make_bench(
        planner_patience=5.0, planner_frequency=5.0, planner_max_retries=-1, controller_patience=patience,
        controller_max_retries=retries)
    arrive(bench)
    bench.script.plan = lambda *ends: failing(NO_WAY, int(bench.script.calls["plan"] % 9 != 1), scripted.line)(*ends)
    bench.script.velocity = failing(STUCK, refused, FORWARD)
    bench.costmaps["global"].costs[100, 112:118] = 254
    task = bench.navigator.move_base(GOAL)
    assert bench.finish(task, 300.0).outcome is outcome


def test_who_stands_in_the_way_after_the_last_recovery_has_the_time_of_one_patience_to_leave_it(make_bench):
    """The goal ended with the first replan in vain: what the controller had refused before the recovery counted."""
    bench = make_bench(planner_patience=5.0, planner_frequency=5.0, planner_max_retries=-1, controller_patience=5.0)
    arrive(bench)
    bench.script.velocity = STUCK
    bench.costmaps["global"].costs[100, 112:118] = 254
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: "R2" in bench.script.calls)
    planned = bench.script.calls["plan"]
    bench.run(lambda: bench.script.calls["plan"] > planned)
    bench.script.plan, bench.script.velocity = failing(NO_WAY, 10, scripted.line), failing(STUCK, 10, FORWARD)
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


def test_a_planner_is_asked_about_what_a_recovery_left_not_about_what_was_seen_before(make_bench):
    bench = make_bench(planner_patience=1.0)
    arrive(bench)
    seen = bench.costmaps["global"]
    cleared_at = []

    def plan(start, goal):
        if not cleared_at or seen.stamp < cleared_at[0]:
            raise NO_WAY
        return scripted.line(start, goal)

    bench.script.plan, bench.script.recovery = plan, lambda context: cleared_at.append(bench.now) or iter(())
    task = bench.navigator.move_base(GOAL)
    for step in range(1000):
        if step % 4 == 3:  # it is updated less often than the navigator
            seen.stamp = bench.now
        if task.done:
            break
        bench.step()
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS
    assert bench.script.calls["R1"] == 1 and "R2" not in bench.script.calls


def test_a_robot_that_sees_all_round_still_clears_its_costmaps_where_no_way_leads_to_its_goal():
    """Of what it may do there only a turn on the spot shows it nothing new."""
    clears, turns, leaves = (
        SimpleNamespace(leaves_place=leaves, only_looks_round=looks)
        for leaves, looks in ((False, False), (False, True), (True, False)))
    for sees_all_round in (False, True):
        costmap = SimpleNamespace(sees_all_round=sees_all_round)
        assert can_change(BY_SEEING, clears, costmap) and can_change(BY_SEEING, leaves, costmap)
        assert can_change(BY_SEEING, turns, costmap) is not sees_all_round


def test_a_robot_that_hardly_moved_does_not_recover_in_the_same_way_for_ever():
    trials = TriedBehaviors(["a", "b"])
    tried = [trials.next(Pose2D(0.05 * (step % 2), 0.0, 0.0), 0.0, bool) for step in range(4)]
    assert tried == [0, 1, None, None]
    assert trials.next(Pose2D(0.4, 0.0, 0.0), 0.5, bool) is None, "no progress as yet"
    assert trials.next(Pose2D(0.6, 0.0, 0.0), 0.5, bool) == 0


def test_what_was_tried_by_odometry_nobody_could_believe_is_tried_again_at_the_same_place():
    trials, here = TriedBehaviors(["a", "b"]), Pose2D(0.0, 0.0, 0.0)
    for is_certain, expected in ((True, 0), (False, 1), (False, None), (True, 0), (True, 1), (True, None)):
        assert trials.next(here, 0.5, bool, is_certain) == expected


def test_a_robot_that_knows_where_it_is_after_a_first_failure_without_a_pose_is_recovered_there():
    trials = TriedBehaviors(["a", "b"])
    for pose, expected in ((None, 0), (None, 1), (Pose2D(0.0, 0.0, 0.0), 0), (None, 1)):
        assert trials.next(pose, 0.5, bool) == expected
