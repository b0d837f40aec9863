"""Plans: frames, retries, patience, cancelling, and planners that misbehave."""

import math

import numpy as np
import pytest
import scripted
from scripted import NO_WAY

from mbf_relay.geometry import Pose2D
from mbf_relay.navigation.goals import FramedPose, PlanGoal
from mbf_relay.navigation.refused_places import Toll
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.path import Path

TARGET = FramedPose(Pose2D(1.0, 0.5, 0.3), "map")


def test_a_path_leads_from_the_robot_to_the_target(bench):
    bench.robot.pose = Pose2D(0.2, 0.1, 0.0)
    result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert result.outcome is PlanOutcome.SUCCESS
    assert result.path.poses[0] == pytest.approx((0.2, 0.1, 0.0))
    assert result.path.poses[-1] == pytest.approx(TARGET.pose)
    assert result.cost == 1.0
    assert bench.robot.sent == []


def test_a_users_planner_is_asked_once_with_the_costmap_as_it_is(bench):
    costmap = bench.costmaps["global"]
    costmap.footprint = np.array([[-0.3, -0.3], [-0.3, 0.3], [0.1, 0.3], [0.1, -0.3]])
    for y in (0.2, -0.2):  # a passage the robot does not fit through lies on the way
        column, row = costmap.grid.cell_at(0.5, 0.25 + y)
        costmap.costs[row, column - 4:column + 4] = 254
    before = costmap.costs.copy()
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).outcome is PlanOutcome.SUCCESS
    (seen,) = bench.script.planned_on
    assert (seen.costs == before).all()


def test_a_given_start_is_used(bench):
    goal = PlanGoal(TARGET, start=FramedPose(Pose2D(3.0, 3.0, 0.0), "odom"))
    assert bench.finish(bench.navigator.get_path(goal)).path.poses[0] == pytest.approx((3.0, 3.0, 0.0))


def test_a_planner_without_a_cost_of_its_own_is_given_the_length(bench):
    bench.script.plan = lambda start, goal: Path(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]), "map")
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).cost == pytest.approx(5.0)


@pytest.mark.parametrize("picture", [math.inf, 999.9], ids=["after the goal", "before the goal"])
def test_failures_are_tried_again_until_patience_ends(bench, picture):
    bench.script.plan, bench.costmaps["global"].stamp = NO_WAY, picture
    started = bench.now
    task = bench.navigator.get_path(PlanGoal(TARGET))
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.PAT_EXCEEDED and task.ending is Ending.ABORTED
    assert "walls all around" in result.message
    assert 1.0 <= bench.now - started <= 1.2
    assert 4 <= bench.script.calls["plan"] <= 7


@pytest.mark.parametrize("retries, calls", [(0, 1), (1, 2), (3, 4)])
def test_retries_are_counted(make_bench, retries, calls):
    bench = make_bench(planner_max_retries=retries, planner_patience=0.0)
    bench.script.plan = NO_WAY
    result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert result.outcome is PlanOutcome.NO_PATH_FOUND
    assert bench.script.calls["plan"] == calls


def test_a_way_that_opens_is_found(bench):
    answers = [NO_WAY, NO_WAY, scripted.straight_path()]

    def plan(start, goal):
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    bench.script.plan = plan
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).outcome is PlanOutcome.SUCCESS


def test_waiting_does_not_mend_a_goal_outside_the_map(bench):
    bench.script.plan = PlanningError(PlanOutcome.OUT_OF_MAP, "goal (90, 0) lies outside")
    result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert result.outcome is PlanOutcome.OUT_OF_MAP and bench.script.calls["plan"] == 1


def test_outside_the_map_is_believed_of_a_picture_taken_after_the_goal_came(bench):
    bench.script.plan = PlanningError(PlanOutcome.OUT_OF_MAP, "the start lies outside")
    bench.costmaps["global"].stamp = bench.now - 0.1
    task = bench.navigator.get_path(PlanGoal(TARGET))
    for _ in range(5):
        bench.step()
    assert not task.done
    bench.script.plan = scripted.line  # the map has followed the robot
    assert bench.finish(task).outcome is PlanOutcome.SUCCESS


def test_a_map_that_does_not_follow_is_not_waited_for_for_ever(make_bench):
    bench = make_bench(tf_timeout=0.5, planner_patience=0.0)
    bench.script.plan = PlanningError(PlanOutcome.OUT_OF_MAP, "the start lies outside")
    bench.costmaps["global"].stamp = bench.now - 0.1
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET)), 1.0).outcome is PlanOutcome.OUT_OF_MAP


def test_what_failed_last_is_told_where_patience_ends(bench):
    bench.script.plan = NO_WAY
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).cause is PlanOutcome.NO_PATH_FOUND


@pytest.mark.parametrize("answer, outcome, text", [
    (RuntimeError("index 7"), PlanOutcome.INTERNAL_ERROR, "RuntimeError: index 7"),
    (None, PlanOutcome.INTERNAL_ERROR, "it returned NoneType, not a path"),
    (SystemExit("plugin wants out"), PlanOutcome.INTERNAL_ERROR, "plugin wants out"),
    (Path(np.array([[0.0, math.nan, 0.0]]), "map"), PlanOutcome.INTERNAL_ERROR, "not finite"),
    (Path(np.zeros((2, 3)), "map", math.nan), PlanOutcome.INTERNAL_ERROR, "not finite"),
    (Path(np.zeros((2, 2)), "map"), PlanOutcome.INTERNAL_ERROR, "shape (2, 2), not (N, 3)"),
    (Path(None, "map"), PlanOutcome.INTERNAL_ERROR, "shape (), not (N, 3)"),
    (Path(np.zeros((2, 3)), 7), PlanOutcome.INTERNAL_ERROR, "whose frame is 7, not a name"),
    (Path(np.zeros((2, 3)), "map", "dear"), PlanOutcome.INTERNAL_ERROR, "whose cost is 'dear', not a number"),
    (Path([], "map"), PlanOutcome.PAT_EXCEEDED, "empty path"),
    (Path(np.zeros((2, 3)), "attic"), PlanOutcome.PAT_EXCEEDED, "planner 'P1' returned: no transform from 'attic'"),
    (Path(np.zeros((0, 3)), "map"), PlanOutcome.PAT_EXCEEDED, "empty path"),
])
def test_a_planner_that_misbehaves_ends_its_goal_and_no_more(bench, answer, outcome, text):
    bench.script.plan = answer
    for tolls in ((), (Toll((0.5, 0.25), 1.0),)):  # also where there is a place to go round
        result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET, tolls=tolls)))
        assert result.outcome is outcome and text in result.message and result.path is None
    bench.script.plan = scripted.line
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).outcome is PlanOutcome.SUCCESS


def test_a_path_written_as_lists_of_whole_numbers_is_one(bench):
    bench.script.plan = Path([[0, 0, 0], [1, 0, 0]], "map")
    found = bench.finish(bench.navigator.get_path(PlanGoal(TARGET))).path
    assert found.poses.dtype == np.float64 and found.poses.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]


def test_a_planner_that_hangs_is_given_up_and_waited_for(held_bench):
    bench = held_bench
    bench.worker.delays = [None]
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step()
    assert bench.navigator.due == pytest.approx(bench.now + 1.0), "its patience's end, for whoever sleeps till then"
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.PAT_EXCEEDED and "has not returned" in result.message
    second = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step()
    assert not second.done
    other = bench.finish(bench.navigator.get_path(PlanGoal(TARGET, planner="P2", slot=1)))
    assert other.outcome is PlanOutcome.SUCCESS
    bench.worker.release()
    assert bench.finish(second).outcome is PlanOutcome.SUCCESS


def test_nobody_is_kept_busy_by_a_planner_whose_patience_has_no_end(make_bench):
    """Navigation was stepped on and on, for a time that was over."""
    bench = make_bench(scripted.HeldWorker(), planner_patience=0.0)
    bench.worker.delays = [None]
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step()
    assert not task.done and bench.navigator.due == math.inf
    bench.worker.release()
    assert bench.finish(task).outcome is PlanOutcome.SUCCESS


def test_a_hanging_planner_does_not_hold_up_other_slots(held_bench):
    bench = held_bench
    bench.worker.delays = [None]
    bench.navigator.get_path(PlanGoal(TARGET, slot=3))
    bench.step()
    assert bench.finish(bench.navigator.get_path(PlanGoal(TARGET, slot=4)), 0.5).outcome is PlanOutcome.SUCCESS


def test_an_unknown_frame_is_waited_for_and_named(bench):
    started, task = bench.now, bench.navigator.get_path(PlanGoal(FramedPose(Pose2D(0.0, 0.0, 0.0), "kitchen")))
    bench.step(0.0)
    assert bench.navigator.due > bench.now, "or waiting would keep a core busy"
    result = bench.finish(task)
    assert result.outcome is PlanOutcome.TF_ERROR and "kitchen" in result.message
    assert bench.now - started == pytest.approx(3.0, abs=0.2)


def test_a_frame_that_comes_late_is_used(bench):
    task = bench.navigator.get_path(PlanGoal(FramedPose(Pose2D(1.0, 0.0, 0.0), "kitchen")))
    bench.step(1.0)
    bench.robot.frames.add("kitchen")
    assert bench.finish(task).outcome is PlanOutcome.SUCCESS


@pytest.mark.parametrize("has_lost", [
    lambda bench, why: setattr(bench.robot, "lost", why),
    lambda bench, why: setattr(bench.costmaps["global"], "trouble", why and PlanningError(PlanOutcome.MAP_ERROR, why))],
    ids=["tf", "costmap"])
def test_a_robot_that_waits_for_a_way_to_open_survives_a_moment_without_a_pose_or_a_costmap(make_bench, has_lost):
    """It was waited for as long since the goal came: after three seconds before a door, not at all."""
    bench = make_bench(planner_patience=0.0)
    bench.script.plan = NO_WAY
    task = bench.navigator.get_path(PlanGoal(TARGET))
    for seconds, why in (10.0, None), (2.0, "it is late"), (10.0, None), (2.0, "it is late again"):
        has_lost(bench, why)
        for _ in range(int(seconds / 0.1)):
            bench.step()
        assert not task.done, task.result.message
    started = bench.now
    result = bench.finish(task)
    assert "it is late again" in result.message and bench.now - started == pytest.approx(1.0, abs=0.3)


def test_without_a_map_the_goal_says_so(bench):
    bench.costmaps["global"].trouble = PlanningError(PlanOutcome.MAP_ERROR, "no map has come on topic 'map'")
    result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert result.outcome is PlanOutcome.MAP_ERROR and "no map" in result.message


def test_a_goal_that_comes_before_the_costmaps_first_picture_is_carried_out_with_it(bench):
    """A goal sent as soon as the relay said that it was there ended three seconds later where the machine was slow."""
    costmap = bench.costmaps["global"]
    costmap.trouble = PlanningError(PlanOutcome.NOT_INITIALIZED, "global_costmap was not updated yet")
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step(15.0)
    assert not task.done
    costmap.trouble = None
    assert bench.finish(task).outcome is PlanOutcome.SUCCESS


def test_a_goal_is_not_lost_to_time_in_which_its_server_was_stopped_and_could_not_wait(bench):
    """Just after a frozen server went on, it took a goal by the clock of before, and gave it up with the next tick."""
    costmap = bench.costmaps["global"]
    costmap.trouble = PlanningError(PlanOutcome.MAP_ERROR, "global_costmap was last updated 6.37 s ago")
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step(0.0)
    bench.step(6.37)
    assert not task.done
    costmap.trouble = None
    assert bench.finish(task, 0.5).outcome is PlanOutcome.SUCCESS


def test_an_unknown_planner_is_rejected_and_the_known_ones_named(bench):
    task = bench.navigator.get_path(PlanGoal(TARGET, planner="navfn/NavfnROS"))
    assert task.ending is Ending.REJECTED and task.result.outcome is PlanOutcome.INVALID_PLUGIN
    assert "navfn/NavfnROS" in task.result.message and "P1, P2" in task.result.message


def test_a_cancelled_plan_tells_the_planner_and_ends(held_bench):
    bench = held_bench
    bench.worker.delays = [None]
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step()
    task.cancel()
    bench.step(0.0)
    assert task.ending is Ending.CANCELED and task.result.outcome is PlanOutcome.CANCELED
    bench.worker.release()
    assert bench.script.called_off == [True]


def test_a_goal_cancelled_before_its_first_step_never_reaches_the_planner(bench):
    task = bench.navigator.get_path(PlanGoal(TARGET))
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and "plan" not in bench.script.calls


def test_a_goal_in_a_busy_slot_replaces_the_one_there(held_bench):
    bench = held_bench
    tasks = [bench.navigator.get_path(PlanGoal(TARGET)) for _ in range(500)]
    bench.finish(tasks[-1])
    assert all(task.ending is Ending.CANCELED for task in tasks[:-1])
    assert tasks[-1].ending is Ending.SUCCEEDED
    assert bench.script.calls["plan"] == 1


def test_slots_do_not_touch_each_other(held_bench):
    bench = held_bench
    tasks = [bench.navigator.get_path(PlanGoal(TARGET, slot=slot)) for slot in range(256)]
    for task in tasks:
        assert bench.finish(task).outcome is PlanOutcome.SUCCESS


def test_the_clock_may_jump_back_while_a_plan_is_tried_again(bench):
    bench.script.plan = NO_WAY
    task = bench.navigator.get_path(PlanGoal(TARGET))
    bench.step(0.5)
    bench.now = 3.0
    assert bench.finish(task, 2.0).outcome is PlanOutcome.PAT_EXCEEDED


def test_each_path_found_is_told_with_its_planner(bench):
    told = []
    bench.navigator.plan_watcher = lambda name, path: told.append((name, path))
    result = bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert told == [(bench.navigator.planners.names[0], result.path)]
    bench.script.plan = NO_WAY
    bench.finish(bench.navigator.get_path(PlanGoal(TARGET)))
    assert len(told) == 1
