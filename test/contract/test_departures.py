"""How planners have a robot leave where it stands, though it stands where it could not be led to."""

import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from planners import CASES, made, plan  # noqa: E402
from test_planners import RESOLUTION, at, outcome_of, snapshot  # noqa: E402

from mbf_relay.costmap.cost_grid import LETHAL  # noqa: E402
from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.outcomes import PlanOutcome  # noqa: E402
from mbf_relay.planning.planner import Cancellation  # noqa: E402


@pytest.fixture(name="case", params=sorted(CASES))
def each_planner(request):
    return request.param


@pytest.fixture(name="planner")
def make_planner(case):
    return made(case)


@pytest.mark.parametrize("past", [(-0.25, 0.0), (0.0, 5.25), (5.2, -0.2)])
def test_a_robot_that_got_a_little_past_the_edge_of_its_map_comes_back(planner, past):
    """It cut a corner along the edge, and its goal was given up."""
    costmap = snapshot(np.zeros((5, 5)))
    middle = at(costmap, 2, 2)
    start = Pose2D(costmap.grid.origin_x + past[0] * RESOLUTION, costmap.grid.origin_y + past[1] * RESOLUTION, 0.3)
    path = planner.plan(costmap, start, middle, 0.0, Cancellation())
    assert path.poses[0, :2] == pytest.approx(start[:2]) and path.poses[-1, :2] == pytest.approx(middle[:2])
    assert all(costmap.grid.contains_point(*point) for point in path.poses[1:, :2])


def test_a_robot_too_near_an_obstacle_may_leave(planner):
    costs = np.zeros((9, 9))
    costs[4, 3:6] = costs[3:6, 4] = 253
    costs[4, 4] = LETHAL
    costmap = snapshot(costs)
    path = plan(planner, costmap, at(costmap, 4, 3), at(costmap, 0, 0))
    assert tuple(path.poses[0, :2]) == pytest.approx(at(costmap, 4, 3)[:2])
    assert outcome_of(planner, costmap, at(costmap, 4, 4), at(costmap, 0, 0)) is PlanOutcome.BLOCKED_START


def test_a_robot_may_leave_a_dock_whose_walls_are_near_all_along_but_not_through_what_is_unknown(case):
    """It stood there for good: no cell was free within its inscribed radius."""
    costs = np.zeros((9, 30))
    costs[2:7, :20] = 253
    costs[2, :20] = costs[6, :20] = LETHAL
    costmap, start, goal, planner = snapshot(costs), (14, 4), (28, 1), made(case, allow_unknown=False)
    assert 20 - start[0] < 4.0 * costmap.width / RESOLUTION, "the dock's end is near enough"
    path = plan(planner, costmap, at(costmap, *start), at(costmap, *goal))
    assert tuple(path.poses[0, :2]) == pytest.approx(at(costmap, *start)[:2])
    assert path.goal.distance_to(at(costmap, *goal)) < 1e-9
    assert np.hypot(*np.diff(path.poses[:, :2], axis=0).T).max() < 1.5 * RESOLUTION, "it goes to and fro"
    costs[3:6, 17] = 255
    assert outcome_of(planner, snapshot(costs), at(costmap, *start), at(costmap, *goal)) is PlanOutcome.BLOCKED_START
