"""The planner for global_planner/GlobalPlanner, with its parameters, on this package's own searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.parameters import ParameterSet, parameter, without_effect
from mbf_relay.planning.grid_planner import GridPlanner, SearchQuery
from mbf_relay.planning.navfn import descend_potential
from mbf_relay.planning.orientation import OrientationMode, oriented
from mbf_relay.planning.planner import PotentialDisplay
from mbf_relay.planning.search.incremental_field import CostToGo, FastMarchingPotential, IncrementalField
from mbf_relay.planning.weights import global_planner_weights, path_cost

RECONFIGURABLE = (
    "lethal_cost", "neutral_cost", "cost_factor", "publish_potential", "orientation_mode", "orientation_window_size",
)
"""What can be changed at run time, as in global_planner."""


@dataclass(frozen=True)
class GlobalPlannerParameters(ParameterSet):
    """Parameters of global_planner, by its names."""

    allow_unknown: bool = parameter(True, "plan through unknown cells")
    default_tolerance: float = parameter(
        0.0, "how far from the goal a path may end, if the request gives no tolerance", unit="m", minimum=0.0)
    use_dijkstra: bool = parameter(
        True, "compute the published potential in all directions, not only towards the goal; paths are the same")
    use_quadratic: bool = without_effect(True, "the potential is always interpolated")
    use_grid_path: bool = parameter(False, "follow cells in 8 directions; false descends the potential's gradient")
    old_navfn_behavior: bool = without_effect(False, "paths do not need it")
    outline_map: bool = without_effect(True, "paths never leave the map")
    lethal_cost: int = parameter(
        253, "cells whose cost is at least this minus one are never entered; weights are limited to less than this",
        minimum=1, maximum=255)
    neutral_cost: int = parameter(50, "weight of a free cell", minimum=1, maximum=255)
    cost_factor: float = parameter(
        3.0, "factor on the costmap's costs, added to neutral_cost", minimum=0.01, maximum=5.0)
    publish_potential: bool = parameter(True, "publish the potential if there is a subscriber")
    publish_scale: int = parameter(100, "published value of the highest potential", minimum=1, maximum=127)
    orientation_mode: int = parameter(
        1, "headings along the path: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 "
        "leftward, 6 rightward", choices=tuple(int(mode) for mode in OrientationMode))
    orientation_window_size: int = parameter(
        1, "number of points before and after each from which its heading is computed", minimum=1, maximum=255)
    planner_window_x: float = parameter(0.0, "read, and without effect, as in global_planner", unit="m")
    planner_window_y: float = parameter(0.0, "read, and without effect, as in global_planner", unit="m")


class GlobalPlanner(GridPlanner):
    """Descends a fast-marching potential, or, with use_grid_path, follows the cheapest 8-connected steps."""

    Parameters = GlobalPlannerParameters
    parameters: GlobalPlannerParameters
    dynamic_config = "mbf_relay.cfg.GlobalPlannerConfig"

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._potential, self._steps = FastMarchingPotential(), CostToGo()

    @property
    def potential_display(self) -> PotentialDisplay:
        return PotentialDisplay("grid", self.parameters.publish_potential, self.parameters.publish_scale)

    def weights(self) -> np.ndarray:
        p = self.parameters
        return global_planner_weights(p.neutral_cost, p.cost_factor, p.lethal_cost, p.allow_unknown)

    def orient(self, points: np.ndarray, start: Pose2D, goal: Pose2D) -> np.ndarray:
        return oriented(
            points, start, goal, self.parameters.orientation_mode, self.parameters.orientation_window_size)

    def _field(self) -> IncrementalField:
        return self._steps if self.parameters.use_grid_path else self._potential

    def potential(self) -> Optional[np.ndarray]:
        return self._field().field()

    def search(self, query: SearchQuery) -> Optional[Tuple[np.ndarray, float]]:
        all_around = self.wants_potential and self.parameters.use_dijkstra
        if not self.parameters.use_grid_path:
            return descend_potential(self._potential, query, all_around)
        return follow_steps(self._steps, query, all_around)


def follow_steps(
    steps: CostToGo, query: SearchQuery, all_around: bool = False
) -> Optional[Tuple[np.ndarray, float]]:
    """Return points, (N, 2) in metres, and the cost of the cheapest 8-connected path, None where there is none.

    Args:
        steps: The field, which is kept between plans.
        query: Start, goal and snapshot.
        all_around: As for `IncrementalField.reach`.

    Raises:
        PlanningError: CANCELED.
    """
    costmap = query.costmap
    if not steps.reach(
        costmap.costs, query.weights, query.start_cell, query.goal_cell, query.cancelled, costmap.revision, all_around):
        return None
    cells = steps.path(costmap.costs, query.start_cell)
    points = costmap.grid.centers_of(cells)
    points[0], points[-1] = query.start[:2], query.goal[:2]
    return points, path_cost(costmap.costs, query.weights, cells)
