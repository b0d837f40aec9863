"""The planner that stands in for navfn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, NO_INFORMATION, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning.field import CostToGo
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner
from mbf_relay.planning.request import checked_cells, headings_along

NEUTRAL, FACTOR, HIGHEST = 50.0, 0.8, 252.0
"""navfn's COST_NEUTRAL, COST_FACTOR and the value just below COST_OBS."""


@dataclass(frozen=True)
class NavfnParameters(ParameterSet):
    """Parameters of navfn, by its names."""

    allow_unknown: bool = parameter(True, "plan through unknown cells")
    default_tolerance: float = parameter(0.0, "how far the goal may be missed", unit="m", minimum=0.0)


class NavfnPlanner(Planner):
    """Plans the cheapest path over 8-connected cells, weighted as navfn weighs costs."""

    Parameters = NavfnParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._field = CostToGo()

    def plan(
        self, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
    ) -> Path:
        weights = navfn_weights(self.parameters.allow_unknown)
        start_cell, goal_cell = checked_cells(costmap, weights, start, goal)
        found = self._field.plan(costmap.costs, weights, start_cell, goal_cell, cancelled)
        if found is None:
            raise PlanningError(
                PlanOutcome.NO_PATH_FOUND,
                f"no path from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f}): no free cells connect them")
        cells, cost = found
        points = costmap.grid.centers_of(cells)
        if len(points) == 1:
            points = np.vstack((points, points))
        points[0], points[-1] = start[:2], goal[:2]
        return Path(headings_along(points, goal.theta), costmap.frame, cost)


def navfn_weights(allow_unknown: bool) -> np.ndarray:
    """Return what navfn makes of each cost: shape (256,), float32, 0 where it does not go."""
    weights = np.minimum(NEUTRAL + FACTOR * np.arange(256), HIGHEST)
    weights[INSCRIBED:] = 0.0
    if allow_unknown:
        weights[NO_INFORMATION] = HIGHEST
    return np.floor(weights).astype(np.float32)
