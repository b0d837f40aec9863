"""Every outcome of every action provoked once, by name; a name nobody can provoke would be a promise without a keeper.
"""

import pytest
import scripted

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.navigation.goals import FollowGoal, FramedPose, NavigateGoal, NavigateOutcome, PlanGoal, RecoverGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import (
    ControlError,
    ControlOutcome,
    PlanningError,
    PlanOutcome,
    RecoveryError,
    RecoveryOutcome,
    TransformError,
)
from mbf_relay.planning.path import Path

TARGET = FramedPose(Pose2D(1.0, 0.0, 0.0), "map")
PATH = scripted.straight_path()

AT_THE_EDGE = {PlanOutcome.STOPPED, ControlOutcome.STOPPED, RecoveryOutcome.STOPPED, NavigateOutcome.STOPPED}
"""Given when the node goes down; test/node/navigation_test.py tells it to."""

UNUSED = {
    NavigateOutcome.FAILURE, NavigateOutcome.COLLISION, NavigateOutcome.START_BLOCKED, NavigateOutcome.GOAL_BLOCKED,
    NavigateOutcome.TF_ERROR, NavigateOutcome.INTERNAL_ERROR,
}
"""move_base's own names for what its parts have more exact names for, which it passes on instead, as upstream does."""


def no_way(outcome):
    """A planner that says so itself, of which the server tries no second time."""
    def provoke(bench):
        bench.script.plan = PlanningError(outcome, f"because of {outcome.name}")
        return bench.navigator.get_path(PlanGoal(TARGET))

    return provoke


def no_command(outcome):
    def provoke(bench):
        bench.script.velocity = ControlError(outcome, f"because of {outcome.name}")
        return bench.navigator.exe_path(FollowGoal(PATH))

    return provoke


def gives_up(outcome):
    def provoke(bench):
        def recover(context):
            yield STOP
            raise RecoveryError(outcome, f"because of {outcome.name}")

        bench.script.recovery = recover
        return bench.navigator.recovery(RecoverGoal())

    return provoke


def cancelled(task):
    task.cancel()
    return task


def setting(where, name, value, then):
    """Set something on the bench, then send."""
    def provoke(bench):
        setattr(where(bench), name, value)
        return then(bench)

    return provoke


def plan(bench, **goal):
    return bench.navigator.get_path(PlanGoal(TARGET, **goal))


def drive(bench, **goal):
    return bench.navigator.exe_path(FollowGoal(PATH, **goal))


def recover(bench, behavior="R1"):
    return bench.navigator.recovery(RecoverGoal(behavior))


def navigate(bench):
    return bench.navigator.move_base(NavigateGoal(TARGET))


def script(bench):
    return bench.script


def robot(bench):
    return bench.robot


def global_costmap(bench):
    return bench.costmaps["global"]


TABLE = {
    PlanOutcome.SUCCESS: (plan, Ending.SUCCEEDED),
    **{
        outcome: (no_way(outcome), Ending.ABORTED)
        for outcome in (
            PlanOutcome.FAILURE,
            PlanOutcome.INVALID_START,
            PlanOutcome.INVALID_GOAL,
            PlanOutcome.BLOCKED_START,
            PlanOutcome.BLOCKED_GOAL,
            PlanOutcome.NO_PATH_FOUND,
            PlanOutcome.OUT_OF_MAP,
        )
    },
    PlanOutcome.CANCELED: (lambda bench: cancelled(plan(bench)), Ending.CANCELED),
    PlanOutcome.EMPTY_PATH: (setting(script, "plan", Path(PATH.poses[:0], "map"), plan), Ending.ABORTED),
    PlanOutcome.TF_ERROR: (setting(robot, "lost", "no transform from 'base' to 'map'", plan), Ending.ABORTED),
    PlanOutcome.NOT_INITIALIZED: (
        setting(global_costmap, "trouble", PlanningError(PlanOutcome.NOT_INITIALIZED, "never updated"), plan),
        Ending.ABORTED,
    ),
    PlanOutcome.MAP_ERROR: (
        setting(global_costmap, "trouble", PlanningError(PlanOutcome.MAP_ERROR, "no map"), plan),
        Ending.ABORTED,
    ),
    PlanOutcome.INVALID_PLUGIN: (lambda bench: plan(bench, planner="nobody"), Ending.REJECTED),
    PlanOutcome.INTERNAL_ERROR: (setting(script, "plan", ZeroDivisionError("oops"), plan), Ending.ABORTED),
    ControlOutcome.SUCCESS: (setting(script, "reached", True, drive), Ending.SUCCEEDED),
    **{
        outcome: (no_command(outcome), Ending.ABORTED)
        for outcome in (
            ControlOutcome.FAILURE,
            ControlOutcome.NO_VALID_CMD,
            ControlOutcome.COLLISION,
            ControlOutcome.MISSED_GOAL,
            ControlOutcome.MISSED_PATH,
            ControlOutcome.BLOCKED_GOAL,
            ControlOutcome.BLOCKED_PATH,
            ControlOutcome.OUT_OF_MAP,
            ControlOutcome.MAP_ERROR,
            ControlOutcome.NOT_INITIALIZED,
        )
    },
    ControlOutcome.CANCELED: (lambda bench: cancelled(drive(bench)), Ending.CANCELED),
    ControlOutcome.PAT_EXCEEDED: (
        setting(lambda bench: bench.costmaps["local"], "stale", "source 'scan' is 9 s old", drive),
        Ending.ABORTED,
    ),
    ControlOutcome.OSCILLATION: (setting(script, "velocity", Twist2D(0.01, 0.0, 0.0), drive), Ending.ABORTED),
    ControlOutcome.ROBOT_STUCK: (setting(robot, "held", True, drive), Ending.ABORTED),
    ControlOutcome.INVALID_PATH: (
        lambda bench: bench.navigator.exe_path(FollowGoal(Path(PATH.poses[:0], "map"))),
        Ending.ABORTED,
    ),
    ControlOutcome.TF_ERROR: (setting(robot, "lost", "no transform from 'base' to 'odom'", drive), Ending.ABORTED),
    ControlOutcome.INVALID_PLUGIN: (lambda bench: drive(bench, controller="nobody"), Ending.REJECTED),
    ControlOutcome.INTERNAL_ERROR: (setting(script, "velocity", ZeroDivisionError("oops"), drive), Ending.ABORTED),
    RecoveryOutcome.SUCCESS: (recover, Ending.SUCCEEDED),
    **{
        outcome: (gives_up(outcome), Ending.SUCCEEDED)
        for outcome in (RecoveryOutcome.FAILURE, RecoveryOutcome.IMPASSABLE, RecoveryOutcome.NOT_INITIALIZED)
    },
    RecoveryOutcome.CANCELED: (lambda bench: cancelled(recover(bench)), Ending.CANCELED),
    RecoveryOutcome.PAT_EXCEEDED: (
        setting(script, "recovery", lambda context: (STOP for _ in range(10**6)), recover),
        Ending.ABORTED,
    ),
    RecoveryOutcome.TF_ERROR: (setting(script, "recovery", TransformError("no transform"), recover), Ending.SUCCEEDED),
    RecoveryOutcome.INVALID_PLUGIN: (lambda bench: recover(bench, "nobody"), Ending.REJECTED),
    RecoveryOutcome.INTERNAL_ERROR: (setting(script, "recovery", ZeroDivisionError("oops"), recover), Ending.ABORTED),
    NavigateOutcome.SUCCESS: (setting(script, "reached", True, navigate), Ending.SUCCEEDED),
    NavigateOutcome.CANCELED: (lambda bench: cancelled(navigate(bench)), Ending.CANCELED),
    NavigateOutcome.OSCILLATION: (setting(script, "velocity", Twist2D(0.01, 0.0, 0.0), navigate), Ending.ABORTED),
}


@pytest.mark.parametrize("outcome", list(TABLE), ids=str)
def test_an_outcome_comes_from_its_cause(make_bench, outcome):
    bench = make_bench(
        planner_max_retries=0, controller_max_retries=0, oscillation_timeout=3.0, cmd_vel_ignored_tolerance=2.0,
        recovery_patience=5.0)
    provoke, ending = TABLE[outcome]
    task = provoke(bench)
    result = bench.finish(task)
    assert result.outcome is outcome, f"{result.outcome}: {result.message}"
    assert task.ending is ending
    assert len(result.message) > 3 and not result.message.endswith("\n")


@pytest.mark.parametrize("timeout", [4.9, 5.0, 5.1])
def test_a_robot_that_ignores_its_commands_and_so_makes_no_progress_ends_its_goal_once(make_bench, timeout):
    bench = make_bench(oscillation_timeout=timeout, oscillation_distance=0.3, cmd_vel_ignored_tolerance=5.0)
    bench.robot.held = True
    assert bench.finish(drive(bench)).outcome in (ControlOutcome.ROBOT_STUCK, ControlOutcome.OSCILLATION)


def test_a_hanging_planner_is_the_cause_of_an_exceeded_patience(held_bench):
    held_bench.worker.delays = [None]
    assert held_bench.finish(plan(held_bench)).outcome is PlanOutcome.PAT_EXCEEDED


def test_no_outcome_is_left_out():
    provoked = set(TABLE) | AT_THE_EDGE | UNUSED | {PlanOutcome.PAT_EXCEEDED}
    for outcomes in (PlanOutcome, ControlOutcome, RecoveryOutcome, NavigateOutcome):
        assert not set(outcomes) - provoked, f"nobody provokes {set(outcomes) - provoked}"
