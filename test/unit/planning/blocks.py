"""Floors with blocks on them, and planners to cross them."""

import numpy as np

from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.grid import Grid
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Planner

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
