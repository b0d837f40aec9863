"""Whatever plugins do and whenever goals come, go and are called off: each ends once, in time, and the robot stands."""

import math

import numpy as np
import scripted
from hypothesis import given, settings
from hypothesis import strategies as st
from scripted_bench import Bench

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
)
from mbf_relay.planning.path import Path

LIMIT = 60.0
"""Seconds of the fake clock within which every goal must have ended: all patience of move_base's parts, twice over."""

planning = st.sampled_from([
    "path", "path", "path", PlanningError(PlanOutcome.NO_PATH_FOUND, "no way"), RuntimeError("broken"),
    PlanningError(PlanOutcome.BLOCKED_GOAL, "a chair"), PlanningError(PlanOutcome.MAP_ERROR, "no map"),
    Path(np.zeros((0, 3)), "map"), Path(np.array([[math.nan, 0.0, 0.0]]), "map"), None,
])
driving = st.sampled_from(
    [
        scripted.FORWARD,
        scripted.FORWARD,
        scripted.FORWARD,
        ControlError(ControlOutcome.NO_VALID_CMD, "blocked"),
        ControlError(ControlOutcome.TF_ERROR, "lost"),
        ControlError(ControlOutcome.BLOCKED_PATH, "a chair"),
        ValueError("broken"),
        Twist2D(math.nan, 0.0, 0.0),
        "fast",
    ]
)
recovering = st.sampled_from(
    [
        (0, None),
        (3, None),
        (2, RecoveryError(RecoveryOutcome.IMPASSABLE, "no room")),
        (1, KeyError("broken")),
        (10**6, None),
    ]
)
delays = st.lists(st.sampled_from([1, 1, 1, 1, 2, 5, None]), max_size=30)
events = st.lists(
    st.one_of(
        st.tuples(
            st.just("goal"), st.sampled_from(["get_path", "exe_path", "recovery", "move_base"]), st.integers(0, 2)
        ),
        st.tuples(st.just("cancel"), st.integers(0, 20), st.just(0)),
        st.tuples(st.just("steps"), st.integers(0, 12), st.just(0)),
        st.tuples(st.just("blind"), st.booleans(), st.just(0)),
        st.tuples(st.just("clock back"), st.just(0), st.just(0)),
    ),
    min_size=1,
    max_size=25,
)


def cycle(answers, otherwise):
    """Give the answers one after the other, raising those that are exceptions, then always the last resort."""
    left = list(answers)

    def answer(*arguments):
        what = left.pop(0) if left else otherwise
        if isinstance(what, Exception):
            raise what
        return scripted.line(*arguments) if isinstance(what, str) and what == "path" else what

    return answer


def send(bench, action, slot):
    target = FramedPose(Pose2D(bench.robot.pose.x + 1.0, 0.0, 0.0), "map")
    return {
        "get_path": lambda: bench.navigator.get_path(PlanGoal(target, slot=slot)),
        "exe_path": lambda: bench.navigator.exe_path(
            FollowGoal(scripted.straight_path(), slot=slot, controller=f"C{1 + slot % 2}")
        ),
        "recovery": lambda: bench.navigator.recovery(RecoverGoal(f"R{1 + slot % 2}", slot)),
        "move_base": lambda: bench.navigator.move_base(NavigateGoal(target)),
    }[action]()


@given(events, st.lists(planning, max_size=6), st.lists(driving, max_size=20), recovering, delays, st.booleans())
@settings(max_examples=300)
def test_every_goal_ends_once_and_in_time_and_the_robot_stands(script, plans, velocities, recovery, wait, replan):
    bench = Bench(scripted.HeldWorker(), planner_frequency=5.0 if replan else 0.0, oscillation_timeout=5.0)
    bench.worker.delays = wait
    bench.script.plan = cycle(plans, "path")
    drive = cycle(velocities, scripted.FORWARD)
    bench.script.velocity = lambda state: drive()
    bench.script.reached = lambda state: math.hypot(state.pose.x, state.pose.y) > 3.0  # recoveries may have turned it
    count, failure = recovery

    def recover(context):
        for _ in range(count):
            yield Twist2D(0.0, 0.0, 0.5)
        if failure is not None:
            raise failure

    bench.script.recovery = recover
    tasks = []
    for kind, value, slot in script:
        if kind == "goal":
            tasks.append(send(bench, value, slot))
        elif kind == "cancel" and tasks:
            tasks[value % len(tasks)].cancel()
        elif kind == "blind":
            bench.costmaps["local"].stale = "source 'scan' is old" if value else None
        elif kind == "clock back":
            bench.now = 10.0
        for _ in range(value if kind == "steps" else 0):
            bench.step()
            assert all(velocity.is_finite() for velocity in bench.robot.sent[-3:])
    bench.costmaps["local"].stale = None
    bench.run(lambda: all(task.done for task in tasks), LIMIT)
    assert all(task.ending in Ending and task.result.message for task in tasks)
    assert bench.navigator.idle and bench.navigator.due == math.inf
    assert bench.robot.sent[-1:] in ([], [STOP])
    sent = len(bench.robot.sent)
    for _ in range(20):
        bench.step()
    assert len(bench.robot.sent) == sent, "something was sent after everything had ended"
    bench.worker.release()
    bench.worker.delays = []
    bench.script.plan, bench.script.velocity = scripted.line, scripted.FORWARD
    bench.robot.pose = Pose2D(2.5, 0.0, 0.0)
    assert bench.finish(send(bench, "move_base", 0)).outcome is NavigateOutcome.SUCCESS


@given(events)
@settings(max_examples=100)
def test_the_due_time_is_never_missed(script):
    """Stepping only when something is due gives the same endings as stepping all the time."""
    endings = []
    for eager in (True, False):
        bench = Bench(planner_frequency=5.0, planner_max_retries=0)
        bench.script.plan = scripted.failing(scripted.NO_WAY, 1, scripted.line)  # so that move_base recovers, too
        bench.script.recovery = lambda context: iter([Twist2D(0.0, 0.0, 0.5)] * 5)
        bench.script.reached = lambda state: math.hypot(state.pose.x, state.pose.y) > 2.0
        tasks = []
        for kind, value, slot in script:
            if kind == "goal":
                tasks.append(send(bench, value, slot))
            elif kind == "cancel" and tasks:
                tasks[value % len(tasks)].cancel()
            bench.navigator.update(bench.now)
            for _ in range(10 * value if kind == "steps" else 0):
                bench.now += 0.01
                bench.robot.move(0.01)
                if eager or bench.navigator.due <= bench.now + 1e-9:
                    bench.navigator.update(bench.now)
        endings.append(([task.ending for task in tasks], bench.robot.sent))
    assert endings[0] == endings[1]
