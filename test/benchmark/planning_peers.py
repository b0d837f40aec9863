"""What libraries make of the same problems: least-cost paths by scikit-image, a front's travel time by scikit-fmm.

Neither is a dependency: a library that is not installed is left out, with a line that says how to get it.
"""

from __future__ import annotations

import importlib
import sys
from functools import partial
from typing import Any, Iterator, Tuple

import numpy as np

from benchmark.arena import GOAL, START
from benchmark.metric import Metric, time_call
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.planning.weights import navfn_weights

BLOCKED_SPEED = 1e-6
"""Cells per unit of time in what may not be entered; scikit-fmm divides by it."""


def metrics(costmap: CostGrid, repeats: int) -> Iterator[Metric]:
    """Yield the time each library takes for a whole plan, or for the field alone where it has no descent.

    Args:
        costmap: From benchmark.arena, so that start and goal are on it.
        repeats: How often each is timed.
    """
    weights = navfn_weights(allow_unknown=True)[costmap.costs].astype(float)
    start, goal = (costmap.grid.cell_at(pose.x, pose.y)[::-1] for pose in (START, GOAL))
    size = f"{costmap.grid.width} x {costmap.grid.height}"
    for library, get, name, call in (
        ("skimage.graph", "apt install python3-skimage", "plan {}, skimage's MCP_Geometric, as grid path", least_cost),
        ("skfmm", "pip install scikit-fmm", "potential {}, scikit-fmm, as navfn's", travel_time),
    ):
        try:
            module = importlib.import_module(library)
        except ImportError:
            print(f"{library} is left out: it is not installed ({get})", file=sys.stderr)
            continue
        yield time_call(name.format(size), partial(call, module, weights, start, goal), repeats)


def least_cost(graph: Any, weights: np.ndarray, start: Tuple[int, int], goal: Tuple[int, int]) -> np.ndarray:
    """Return the cells of the cheapest way over 8-connected steps, shape (N, 2), rows first.

    A step counts as our costs to go have it: the mean of both cells, times its length. Diagonal steps may pass between
    two blocked cells, which ours may not.

    Args:
        graph: The module skimage.graph.
        weights: Shape (height, width): what a cell counts, 0 where it may not be entered.
        start, goal: Row and column.
    """
    search = graph.MCP_Geometric(np.where(weights > 0.0, weights, -1.0))
    search.find_costs([start], [goal])
    return np.array(search.traceback(goal))


def travel_time(skfmm: Any, weights: np.ndarray, start: Tuple[int, int], goal: Tuple[int, int]) -> np.ndarray:
    """Return the time a front from the goal takes to each cell, shape (height, width); it does not stop at the start.

    Args:
        skfmm: The module.
        weights: As for `least_cost`.
        start, goal: Row and column.
    """
    source = np.ones(weights.shape)
    source[goal] = -1.0
    speeds = np.where(weights > 0.0, 1.0 / np.maximum(weights, 1.0), BLOCKED_SPEED)
    return np.asarray(skfmm.travel_time(source, speeds))
