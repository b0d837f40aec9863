"""Lines at any angle, by one field or by two: as good as the better of both."""

import numpy as np
import pytest

from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.planning import PLANNERS, any_angle
from mbf_relay.planning.planner import Cancellation, Planner

SIZE = 160


def made(name, **values):
    return plugins.create("p", name, values, Planner, PLANNERS)


def a_map(seed, blocks, spread):
    """Return a floor with square blocks in it, and costs up to `spread` in patches."""
    chance = np.random.RandomState(seed)
    costs = np.repeat(np.repeat(chance.randint(0, spread + 1, (8, 8)), 20, axis=0), 20, axis=1).astype(np.uint8)
    for _ in range(blocks):
        side, (x, y) = chance.randint(4, 24), chance.randint(8, SIZE - 8, 2)
        costs[y:y + side, x:x + side] = LETHAL
    costs[:8], costs[-8:] = np.minimum(costs[:8], spread), np.minimum(costs[-8:], spread)
    costs[2:6, 2:6] = costs[-6:-2, -6:-2] = 0
    return CostGrid(Grid(0.05, 0.0, 0.0, SIZE, SIZE), costs, "map", np.zeros((0, 2)), 0.02, 0.02)


def plan(planner, costmap):
    return planner.plan(costmap, Pose2D(0.2, 0.2, 0.0), Pose2D(7.8, 7.8, 0.0), 0.0, Cancellation())


@pytest.mark.parametrize("blocks, spread", [(0, 0), (6, 0), (40, 0), (40, 120), (90, 0), (90, 200)])
def test_a_robot_goes_no_longer_way_than_over_cells_nor_than_by_both_fields(monkeypatch, blocks, spread):
    by_one = []
    for seed in range(12):
        costmap = a_map(seed, blocks, spread)
        path = plan(made("any_angle"), costmap)
        over_cells = plan(made("global_planner/GlobalPlanner", use_grid_path=True, cost_factor=0.8), costmap)
        assert path.cost <= over_cells.cost * 1.0003
        with monkeypatch.context() as never:
            never.setattr(any_angle, "TRUSTED", -1.0)
            by_both = plan(made("any_angle"), costmap)
        assert path.cost <= by_both.cost * (1.0 + any_angle.TRUSTED)
        by_one.append(path.cost / by_both.cost)
    assert np.mean(by_one) < 1.001


def test_the_second_field_is_spared_on_a_floor_where_the_first_says_it_all(monkeypatch):
    grown = []
    monkeypatch.setattr(any_angle, "follow_steps", lambda *arguments: grown.append(arguments))
    costmap = a_map(0, 0, 0)
    path = made("any_angle").plan(costmap, Pose2D(0.2, 4.0, 0.0), Pose2D(7.8, 4.1, 0.0), 0.0, Cancellation())
    assert path.length == pytest.approx(np.hypot(7.6, 0.1), rel=1e-3)
    assert grown == []
