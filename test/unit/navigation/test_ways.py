"""What a goal's drive learns of its ways: what it was refused where, and what it does before it knows its place."""

from dataclasses import replace

import numpy as np
import pytest
from scripted import FORWARD, GOAL, arrive, bowed_path

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.geometry import Pose2D
from mbf_relay.navigation.goals import FollowFeedback, FramedPose, NavigateOutcome
from mbf_relay.navigation.ways import Ways
from mbf_relay.outcomes import ControlOutcome
from mbf_relay.planning.path import Path

HERE = FramedPose(Pose2D(0.0, 0.0, 0.0), "map")


def test_a_robot_that_learns_where_it_is_only_after_new_plans_sets_out(make_bench):
    """There is a pose to plan from, and none yet to drive by: odometry comes late."""
    bench = make_bench(planner_frequency=5.0, controller_patience=5.0)
    arrive(bench)
    bench.robot.frames.discard("odom")
    task = bench.navigator.move_base(GOAL)
    bench.run(lambda: bench.script.calls.get("plan", 0) > 3)
    assert FORWARD not in bench.robot.sent and not task.done
    bench.robot.frames.add("odom")
    assert bench.finish(task).outcome is NavigateOutcome.SUCCESS


def test_a_goal_is_not_given_up_for_what_was_refused_before_the_last_velocity(bench):
    ways, path = Ways(bench.robot, bench.costmaps["global"]), bowed_path(0.0)
    told = FollowFeedback(ControlOutcome.SUCCESS, "", HERE)
    refused = replace(told, outcome=ControlOutcome.NO_VALID_CMD, refused=True)
    unasked = replace(told, outcome=ControlOutcome.TF_ERROR)
    counts = []
    for feedback in (refused, refused, unasked, refused, told, unasked, refused):
        ways.watch(1.0, feedback, path, 10.0)
        counts.append(ways.refused)
    assert counts == [1, 2, 2, 3, 0, 0, 1]


@pytest.mark.parametrize("walls, place", [((0.5,), 0.5), ((-0.5, 0.7), 0.7)])
def test_a_robot_that_takes_another_way_from_an_obstacle_remembers_that_and_none_it_has_passed(bench, walls, place):
    costmap = bench.costmaps["global"]
    for wall in walls:
        costmap.costs[98:103, costmap.grid.cell_at(wall + 0.01, 0.0)[0]] = LETHAL
    xs = np.linspace(-1.5, 1.5, 61)
    old, new = (Path(np.column_stack((xs, height * np.cos(xs), 0.0 * xs)), "map") for height in (0.0, 1.0))
    ways = Ways(bench.robot, costmap)
    assert ways.takes(1.0, old, new, HERE)
    (toll,) = ways.tolls(1.0)
    assert toll.place == pytest.approx((place, 0.0), abs=0.16)
