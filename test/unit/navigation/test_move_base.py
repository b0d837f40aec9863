"""move_base: planning, driving, replanning, and being called off at any of them."""

import itertools

import numpy as np
import pytest
import scripted
from scripted import FORWARD, GOAL, NO_WAY, STUCK, arrive, failing

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FollowGoal, FramedPose, NavigateGoal, NavigateOutcome, PlanGoal
from mbf_relay.navigation.path_hysteresis import path_is_blocked
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import ControlError, ControlOutcome, PlanningError, PlanOutcome, RecoveryOutcome


def test_it_plans_and_drives(bench):
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    result = bench.finish(task)
    assert result.outcome is NavigateOutcome.SUCCESS and task.ending is Ending.SUCCEEDED
    assert bench.script.calls["plan"] == 1 and bench.robot.sent[-1] == STOP
    assert result.pose.pose.x == pytest.approx(0.96, abs=0.02) and result.distance == pytest.approx(0.04, abs=0.02)


@pytest.mark.parametrize("ends", ["at its goal", "without a velocity"])
def test_a_drive_that_ends_as_soon_as_it_begins_is_the_end_of_its_goal_without_replanning(make_bench, ends):
    """Nothing was due any more: whoever stepped when it was waited for ever, and a batch never ended."""
    bench = make_bench(planner_frequency=0.0, controller_patience=0.0, recovery_enabled=False)
    if ends == "at its goal":
        arrive(bench, x=-1.0)
    else:
        bench.script.velocity = ControlError(ControlOutcome.INVALID_PATH, "it bends")
    task = bench.navigator.move_base(GOAL)
    for _ in range(20):
        bench.navigator.update(bench.now)
        if task.done:
            break
        assert bench.navigator.due < bench.now + 5.0
        bench.now = max(bench.now, bench.navigator.due)
    assert task.ending is (Ending.SUCCEEDED if ends == "at its goal" else Ending.ABORTED)


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


def test_a_client_hears_where_the_robot_is_while_no_path_is_found_and_while_it_recovers(make_bench):
    bench = make_bench(planner_max_retries=-1, planner_patience=2.0)
    bench.script.plan = NO_WAY
    bench.script.recovery = lambda context: iter([FORWARD] * 10)
    task = bench.navigator.move_base(GOAL)
    for _ in range(30):
        bench.step()
    feedback = task.take_feedback()
    assert len(feedback) == pytest.approx(30, abs=2)
    assert {each.message for each in feedback} == {"looking for a path", "running a recovery behaviour"}
    assert feedback[0].pose.pose == IDENTITY and feedback[-1].pose.pose.x > 0.1


def test_a_client_is_told_nothing_of_a_robot_that_is_nowhere(bench):
    bench.robot.lost = "no transform yet"
    task = bench.navigator.move_base(GOAL)
    for _ in range(3):
        bench.step()
    assert task.take_feedback() == []


@pytest.mark.parametrize("frequency, plans", [(5.0, range(15, 27)), (0.5, range(3, 4))])
def test_it_replans_while_driving_and_keeps_what_was_reached(make_bench, frequency, plans):
    bench = make_bench(scripted.HeldWorker(), planner_frequency=frequency)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: task.done, period=0.05)  # calls take half a control period
    assert task.ending is Ending.SUCCEEDED
    assert bench.script.calls["plan"] in plans
    assert [new for _path, new in bench.script.paths].count(True) == 1
    assert STOP not in bench.robot.sent[:-1]


def test_a_robot_does_not_turn_to_and_fro_between_two_ways_of_one_length(make_bench):
    bench = make_bench(planner_frequency=5.0)
    sides = itertools.cycle([0.4, -0.4])
    bench.script.plan = lambda start, goal: scripted.bowed_path(next(sides))
    bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.script.calls["plan"] > 10)
    assert {path.poses[5, 1] for path, _new in bench.script.paths} == {0.4}


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
    bench = make_bench(planner_frequency=5.0, planner_patience=5.0)
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
    assert result.outcome is PlanOutcome.NO_PATH_FOUND and bench.script.calls["R2"] == 1


@pytest.mark.parametrize("lacks_way", [False, True])
def test_a_costmap_that_is_late_or_a_person_in_the_only_way_is_waited_for(make_bench, lacks_way):
    """The goal was ended at once, by a replan, which waits for nothing: on a busy machine, or without recoveries."""
    bench = make_bench(planner_frequency=5.0, recovery_enabled=not lacks_way)
    arrive(bench)
    task = bench.navigator.move_base(GOAL)
    bench.step()
    costmap = bench.costmaps["global"]
    if lacks_way:
        bench.script.plan = NO_WAY
    else:
        costmap.trouble = PlanningError(PlanOutcome.MAP_ERROR, "global_costmap was last updated 1.10 s ago")
    costmap.costs[100, 115] = 254
    bench.run(lambda: bench.robot.sent[-1] == STOP, 2.0)
    for _ in range(5):
        bench.step()
    assert not task.done and bench.robot.sent[-1] == STOP
    bench.script.plan, costmap.trouble = scripted.line, None
    costmap.costs[:] = 0
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS
    assert not {"R1", "R2"} & set(bench.script.calls)


@pytest.mark.parametrize("is_under_way", [False, True])
def test_a_robot_that_waited_for_a_plan_is_not_said_to_oscillate_once_it_has_one(make_bench, is_under_way):
    """Whoever had more planner_patience than oscillation_timeout saw the goal end as soon as the way was free."""
    bench = make_bench(
        planner_patience=60.0, planner_max_retries=-1, planner_frequency=5.0, oscillation_timeout=5.0,
        oscillation_distance=0.3, recovery_enabled=False)
    arrive(bench)
    bench.script.plan = scripted.line if is_under_way else NO_WAY
    task = bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan, bench.costmaps["global"].costs[100, 112:118] = NO_WAY, 254
    bench.run(lambda: bench.script.calls["plan"] > 40)
    bench.script.plan, bench.costmaps["global"].costs[:] = scripted.line, 0
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


def test_only_what_lies_ahead_blocks_a_path():
    costmap = scripted.PaperCostmap("map")
    poses = scripted.straight_path().poses
    costmap.costs[100, 104] = 254
    assert path_is_blocked(costmap.snapshot(), poses, Pose2D(0.0, 0.0, 0.0))
    assert not path_is_blocked(costmap.snapshot(), poses, Pose2D(0.5, 0.1, 0.0))
    assert not path_is_blocked(costmap.snapshot(), poses + np.array([50.0, 0.0, 0.0]), None)


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


class SlowPlanner(scripted.HeldWorker):
    """Has the planner take some steps."""

    steps, calls = 1, 0

    def start(self, task, kind=""):
        if kind == "planners":
            self.delays, self.calls = [self.steps], self.calls + 1
        return super().start(task, kind)


@pytest.mark.parametrize("steps, stops", [(4, False), (100, True)])
def test_a_new_goal_in_the_middle_of_a_replan_stops_the_robot_only_where_the_planner_does_not_return(
        make_bench, steps, stops):
    """A robot that was sent on several times a second stood again and again."""
    worker = SlowPlanner()
    bench = make_bench(worker, planner_frequency=5.0, planner_patience=10.0)
    bench.navigator.move_base(GOAL)
    bench.run(lambda: worker.calls, period=0.01)
    worker.steps = steps
    bench.run(lambda: worker.calls > 1, period=0.01)
    worker.steps = 1
    bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    bench.run(lambda: [new for _path, new in bench.script.paths] == [True, True], period=0.01)
    assert (STOP in bench.robot.sent) == stops


@pytest.mark.parametrize("ends", ["replaced", "cancelled"])
@pytest.mark.parametrize("calls", [0, 1], ids=["the first plan", "a replan"])
def test_a_planner_whose_path_nobody_wants_any_more_is_called_off(make_bench, ends, calls):
    """It went on to its end, and the next goal waited for it."""
    worker = SlowPlanner()
    bench = make_bench(worker, planner_frequency=5.0, planner_patience=10.0)
    worker.steps = 1 if calls else 1000
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: worker.calls >= calls, period=0.01)
    worker.steps = 1000
    bench.run(lambda: worker.calls > calls, period=0.01)
    if ends == "replaced":
        bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    task.cancel()
    bench.step(0.01)
    worker.release()
    assert bench.script.called_off[calls:] == [True]


@pytest.mark.parametrize("plan, outcome", [
    (NO_WAY, PlanOutcome.NO_PATH_FOUND), (RuntimeError("it broke"), PlanOutcome.INTERNAL_ERROR),
])
def test_a_new_goal_without_a_path_stops_the_old_drive(make_bench, plan, outcome):
    bench = make_bench(planner_max_retries=0, recovery_enabled=False)
    bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = plan
    second = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    assert bench.finish(second).outcome is outcome
    assert bench.robot.sent[-1] == STOP


@pytest.mark.parametrize("target, plan", [
    (FramedPose(Pose2D(0.0, 1.0, 0.0), "atlantis"), scripted.line),
    (FramedPose(Pose2D(0.0, 1.0, 0.0), "map"), NO_WAY),
])
def test_the_robot_does_not_drive_on_to_a_goal_given_up_while_the_new_one_is_tried_again(make_bench, target, plan):
    bench = make_bench(planner_max_retries=-1, planner_patience=5.0, tf_timeout=3.0, planner_frequency=0.0)
    bench.script.velocity = FORWARD
    bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.sent)
    bench.script.plan = plan
    task = bench.navigator.move_base(NavigateGoal(target))
    for _ in range(2):
        bench.step()
    assert not task.done and bench.robot.sent[-1] == STOP
    there = bench.robot.pose
    bench.step(1.0)
    assert bench.robot.pose == there


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


def test_a_new_goal_called_off_before_it_has_a_path_stops_the_drive_to_the_old_one(held_bench):
    """Nobody's goal was left, and the robot would drive on to where it had been sent before."""
    bench = held_bench
    bench.script.velocity = FORWARD
    bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.sent)
    task = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(2.0, 0.0, 0.0), "map")))
    bench.navigator.update(bench.now)
    assert bench.robot.sent[-1] == FORWARD
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent[-1] == STOP and bench.navigator.idle


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


def test_a_robot_sent_one_metre_ahead_of_itself_drives_one_metre(make_bench):
    bench = make_bench(planner_frequency=5.0)
    bench.robot.transform = lambda target, source: bench.robot.pose if (target, source) == ("map", "base") else IDENTITY
    bench.robot.pose = Pose2D(3.0, 0.0, 0.0)
    bench.script.velocity = scripted.FORWARD
    bench.script.reached = lambda state: state.pose.x >= scripted.SCRIPT.paths[-1][0].goal.x - 0.01
    task = bench.navigator.move_base(NavigateGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "base")))
    assert bench.finish(task, 20.0).outcome is NavigateOutcome.SUCCESS
    assert bench.robot.pose.x == pytest.approx(4.0, abs=0.05)


def test_no_velocity_goes_out_after_a_cancel_though_one_was_thought_of_before_it(held_bench):
    bench = held_bench
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.sent)
    sent = list(bench.robot.sent)
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent == [*sent, STOP]
