"""Which way up a map was drawn is nothing a plan may depend on."""

import numpy as np
import pytest
from blocks import SIZE, a_map, made

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.planning.planner import Cancellation

ROOM = SIZE * 0.05
START, GOAL = (0.213, 0.187), (7.821, 7.79)
SYMMETRIES = [(quarters, mirrored) for mirrored in (False, True) for quarters in range(4)]
PLANNERS = {
    "any_angle": {},
    "navfn/NavfnROS": {},
    "global_planner/GlobalPlanner": {},
}


def turned_map(costmap, quarters, mirrored):
    costs = np.rot90(costmap.costs.T if mirrored else costmap.costs, quarters)
    return CostGrid(costmap.grid, np.ascontiguousarray(costs), "map", np.zeros((0, 2)), 0.02, 0.02)


def turned(points, quarters, mirrored):
    points = np.array(points)
    points = points[:, ::-1] if mirrored else points
    for _ in range(quarters):
        points = np.column_stack((points[:, 1], ROOM - points[:, 0]))
    return points


def plan(name, values, costmap, quarters, mirrored):
    start, goal = (Pose2D(*map(float, place), 0.0) for place in turned([START, GOAL], quarters, mirrored))
    return made(name, **values).plan(turned_map(costmap, quarters, mirrored), start, goal, 0.0, Cancellation())


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("blocks, spread", [(6, 0), (40, 0), (40, 120), (90, 0), (90, 200)])
def test_a_robot_goes_the_same_way_on_a_map_that_is_turned_or_mirrored(name, blocks, spread):
    for seed in range(4):
        costmap = a_map(seed, blocks, spread)
        upright = plan(name, PLANNERS[name], costmap, *SYMMETRIES[0])
        for quarters, mirrored in SYMMETRIES[1:]:
            path = plan(name, PLANNERS[name], costmap, quarters, mirrored)
            assert path.cost == pytest.approx(upright.cost, rel=1e-9)
            expected = turned(upright.poses[:, :2], quarters, mirrored)
            assert len(path) == len(expected) and path.poses[:, :2] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("blocks, spread", [(40, 0), (90, 0), (90, 200)])
def test_a_way_over_cells_counts_the_same_on_a_map_that_is_turned_or_mirrored(blocks, spread):
    for seed in range(4):  # of ways that count the same it takes another one now and then
        costs = [
            plan("global_planner/GlobalPlanner", {"use_grid_path": True}, a_map(seed, blocks, spread), *symmetry).cost
            for symmetry in SYMMETRIES]
        assert costs == pytest.approx([costs[0]] * 8, rel=1e-9)
