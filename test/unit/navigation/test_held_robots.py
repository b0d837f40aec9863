"""Robots that a foot, a hand or an emergency stop holds while they have a goal."""

import numpy as np
import pytest
from scripted import GOAL, STOP

from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.outcomes import ControlOutcome

FOLLOWERS = ("dwa_local_planner/DWAPlannerROS", "base_local_planner/TrajectoryPlannerROS", "regulated_pure_pursuit")


def held(make_bench, follower, stuck_timeout, ignored):
    """Return a bench and its goal after its robot, on its way, was held for 30 s."""
    bench = make_bench(
        controllers=[{"name": "C1", "type": follower}], cmd_vel_ignored_tolerance=ignored, oscillation_timeout=0.0,
        C1={"max_vel_x": 0.4, "xy_goal_tolerance": 0.1, "stuck_timeout": stuck_timeout})
    for costmap in bench.costmaps.values():
        costmap.footprint = 0.1 * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.robot.pose.x > 0.1)
    bench.robot.held = True
    end = bench.now + 30.0
    bench.run(lambda: task.done or bench.now > end, 31.0)
    return bench, task


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_robot_with_a_foot_before_its_wheel_stops_pushing_and_says_why(make_bench, follower):
    bench, task = held(make_bench, follower, 2.0, 5.0)
    assert task.done and task.result.outcome == ControlOutcome.ROBOT_STUCK, task.result
    assert bench.robot.sent[-1] == STOP


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_robot_told_to_wait_drives_on_when_its_emergency_stop_is_released_as_under_move_base(make_bench, follower):
    bench, task = held(make_bench, follower, 0.0, 0.0)
    assert not task.done and not {"R1", "R2"} & set(bench.script.calls)
    bench.robot.held = False
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


def test_who_holds_a_robot_is_what_its_feedback_tells_as_long_as_it_stands(make_bench):
    """Its client saw the distance to the goal stay as it was, and nothing else."""
    bench, task = held(make_bench, FOLLOWERS[0], 0.0, 0.0)
    bench.robot.silence = "nobody listens to /cmd_vel"
    task.take_feedback()
    bench.step()
    told, = task.take_feedback()
    assert told.outcome is ControlOutcome.SUCCESS
    assert told.message.startswith("nobody listens to /cmd_vel: Robot has stood still for ")
    bench.robot.held = False
    bench.run(lambda: bench.robot.pose.x > 0.2)
    assert task.take_feedback()[-1].message == ""
