"""What benchmarks plan on is what a server plans on."""

import numpy as np
import pytest
from benchmark.arena import START, arena_costmap

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL


@pytest.mark.parametrize("scale", [1, 4])
def test_planners_are_timed_where_costs_tell_that_the_robots_sides_touch(scale):
    costmap = arena_costmap(scale)
    assert 0 < costmap.turning_cost < costmap.side_cost < INSCRIBED and costmap.revision > 0


def test_an_obstacle_to_go_round_is_inflated_as_the_maps_own():
    x, y = START.x + 0.5, START.y
    before, after = arena_costmap(2), arena_costmap(2, obstacle=(x, y))
    column, row = before.grid.cell_at(x, y)
    assert before.costs[row, column] < INSCRIBED and after.costs[row, column] == LETHAL
    changed = np.argwhere(before.costs != after.costs)
    assert np.ptp(changed, axis=0).min() * before.grid.resolution > 2.0 * before.width
