"""Any-angle planner: straight lines in any direction, for paths cheaper than those from cell to cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning import points_kernels
from mbf_relay.planning.global_planner import follow_steps
from mbf_relay.planning.grid_planner import GridPlanner, SearchQuery
from mbf_relay.planning.navfn import descend_potential
from mbf_relay.planning.orientation import OrientationMode, oriented
from mbf_relay.planning.search import line_kernels
from mbf_relay.planning.search.incremental_field import CostToGo, FastMarchingPotential
from mbf_relay.planning.weights import global_planner_weights

PASSES = 60
"""Passes of string pulling, at most."""
TRUSTED = 0.01
"""Share by which the potential at the start may exceed the cost of the straightened path. Above it the potential is too
coarse to tell on which side of an obstacle the way is shorter; it errs most on paths of a few cells, and at corners.
"""


@dataclass(frozen=True)
class AnyAngleParameters(ParameterSet):
    """Parameters of the any-angle planner."""

    allow_unknown: bool = parameter(True, "plan through unknown cells")
    default_tolerance: float = parameter(
        0.0, "how far from the goal a path may end, if the request gives no tolerance", unit="m", minimum=0.0)
    neutral_cost: int = parameter(50, "weight of a free cell", minimum=1, maximum=255)
    cost_factor: float = parameter(
        0.8, "factor on the costmap's costs, added to neutral_cost", minimum=0.0, maximum=5.0)
    lethal_cost: int = parameter(
        253, "cells whose cost is at least this minus one are never entered", minimum=1, maximum=255)
    spacing: float = parameter(0.05, "distance between the poses of a path", unit="m", above=0.0)
    orientation_mode: int = parameter(
        1, "headings along the path: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 "
        "leftward, 6 rightward", choices=tuple(int(mode) for mode in OrientationMode))


class AnyAnglePlanner(GridPlanner):
    """Straightens the path down a fast-marching potential by string pulling.

    Where the potential is too coarse, see TRUSTED, it straightens the cheapest path over 8-connected steps as well, and
    takes the cheaper of both. A line costs its length in each cell times the cell's weight, and string pulling never
    raises a path's cost (compare Theta*: Daniel, Nash, Koenig and Felner, 2010).
    """

    Parameters = AnyAngleParameters
    parameters: AnyAngleParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._potential, self._steps = FastMarchingPotential(), CostToGo()

    def weights(self) -> np.ndarray:
        p = self.parameters
        return global_planner_weights(p.neutral_cost, p.cost_factor, p.lethal_cost, p.allow_unknown)

    def orient(self, points: np.ndarray, start: Pose2D, goal: Pose2D) -> np.ndarray:
        return oriented(points, start, goal, self.parameters.orientation_mode)

    def potential(self) -> Optional[np.ndarray]:
        return self._potential.field()

    def search(self, query: SearchQuery) -> Optional[Tuple[np.ndarray, float]]:
        down = descend_potential(self._potential, query, all_around=self.wants_potential)
        if down is None:
            return None
        weights = self._potential.table
        points, cost = _pulled(query.costmap, weights, down[0])
        if down[1] > (1.0 + TRUSTED) * cost:
            steps = follow_steps(self._steps, query)
            if steps is not None:
                points, cost = min((points, cost), _pulled(query.costmap, weights, steps[0]), key=lambda way: way[1])
        return spaced(points, self.parameters.spacing), cost


def _pulled(costmap: CostGrid, weights: np.ndarray, points: np.ndarray) -> Tuple[np.ndarray, float]:
    """Return a path's points, (N, 2) in metres, after string pulling, and the path's cost."""
    grid = costmap.grid
    place = (grid.origin_x, grid.origin_y, grid.resolution)
    cells = np.empty(points.shape)
    points_kernels.to_cells(points, *place, cells)
    cells = cells[:line_kernels.pull_string(costmap.costs, weights, cells, PASSES)]
    pulled = np.empty(cells.shape)
    points_kernels.to_metres(cells, *place, pulled)
    pulled[0], pulled[-1] = points[0], points[-1]
    return pulled, line_kernels.polyline_cost(costmap.costs, weights, cells)


def spaced(points: np.ndarray, spacing: float) -> np.ndarray:
    """Return a path, (N, 2) in metres, with points added so that no two in a row are over `spacing` (m) apart."""
    parts = np.empty(len(points) - 1, dtype=np.int64)
    along = np.empty((points_kernels.split(points, spacing, parts) + 1, 2))
    points_kernels.spread_along(points, parts, along)
    return along
