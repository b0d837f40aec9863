"""Lines at any angle, by one field or by two: as good as the better of both."""

import numpy as np
import pytest
from blocks import a_map, made

from mbf_relay.geometry import Pose2D
from mbf_relay.planning import any_angle
from mbf_relay.planning.planner import Cancellation


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
