"""The planner for navfn/NavfnROS: a smooth path down a fast-marching potential."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning import points_kernels
from mbf_relay.planning.grid_planner import GridPlanner, SearchQuery
from mbf_relay.planning.planner import PotentialDisplay
from mbf_relay.planning.search.incremental_field import FastMarchingPotential
from mbf_relay.planning.weights import navfn_weights


@dataclass(frozen=True)
class NavfnParameters(ParameterSet):
    """Parameters of navfn, by its names."""

    allow_unknown: bool = parameter(True, "plan through unknown cells")
    default_tolerance: float = parameter(
        0.0, "how far from the goal a path may end, if the request gives no tolerance", unit="m", minimum=0.0)
    visualize_potential: bool = parameter(False, "publish the potential as a point cloud")
    planner_window_x: float = parameter(0.0, "read, and without effect, as in navfn", unit="m")
    planner_window_y: float = parameter(0.0, "read, and without effect, as in navfn", unit="m")


class NavfnPlanner(GridPlanner):
    """Plans as navfn does, but with the exact fast-marching update, a heuristic, and a potential kept between plans."""

    Parameters = NavfnParameters
    parameters: NavfnParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._potential = FastMarchingPotential()

    @property
    def potential_display(self) -> PotentialDisplay:
        return PotentialDisplay("cloud", self.parameters.visualize_potential)

    def weights(self) -> np.ndarray:
        return navfn_weights(self.parameters.allow_unknown)

    def potential(self) -> Optional[np.ndarray]:
        return self._potential.field()

    def search(self, query: SearchQuery) -> Optional[Tuple[np.ndarray, float]]:
        return descend_potential(self._potential, query, all_around=self.wants_potential)


def descend_potential(
    potential: FastMarchingPotential, query: SearchQuery, all_around: bool = False
) -> Optional[Tuple[np.ndarray, float]]:
    """Return points, (N, 2) in metres, and the cost of the path down a potential, None where there is none.

    Args:
        potential: The field, which is kept between plans.
        query: Start, goal and snapshot.
        all_around: As for `IncrementalField.reach`.

    Raises:
        PlanningError: CANCELED.
    """
    costmap, grid = query.costmap, query.costmap.grid
    if not potential.reach(
        costmap.costs, query.weights, query.start_cell, query.goal_cell, query.cancelled, costmap.revision, all_around):
        return None
    start = (query.start.x - grid.origin_x) / grid.resolution, (query.start.y - grid.origin_y) / grid.resolution
    cells = potential.path(start)
    points = np.empty((len(cells) + 1, 2))
    points_kernels.to_metres(cells, grid.origin_x, grid.origin_y, grid.resolution, points)
    points[0, 0], points[0, 1] = query.start.x, query.start.y
    points[-1, 0], points[-1, 1] = query.goal.x, query.goal.y
    return points, potential.cost_at(*start)
