"""The planner that stands in for navfn: a smooth path down the potential of a wave from the goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning.field import Wave
from mbf_relay.planning.grid_planner import GridPlanner, Leg
from mbf_relay.planning.weights import navfn_weights


@dataclass(frozen=True)
class NavfnParameters(ParameterSet):
    """Parameters of navfn, by its names."""

    allow_unknown: bool = parameter(True, "plan through unknown cells")
    default_tolerance: float = parameter(0.0, "how far the goal may be missed, where a request says no more", unit="m", minimum=0.0)
    visualize_potential: bool = parameter(False, "publish the potential as a point cloud")
    planner_window_x: float = parameter(0.0, "read for navfn's sake; without effect there, too", unit="m")
    planner_window_y: float = parameter(0.0, "read for navfn's sake; without effect there, too", unit="m")


class NavfnPlanner(GridPlanner):
    """Plans as navfn does, with the exact wave update, a heuristic, and a potential kept between plans."""

    Parameters = NavfnParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._wave = Wave()
        self._weights = navfn_weights(parameters.allow_unknown)

    def reconfigure(self, parameters: Any) -> None:
        super().reconfigure(parameters)
        self._weights = navfn_weights(parameters.allow_unknown)

    def weights(self) -> np.ndarray:
        return self._weights

    def potential(self) -> Optional[np.ndarray]:
        return self._wave.field()

    def search(self, leg: Leg) -> Optional[Tuple[np.ndarray, float]]:
        return descend_wave(self._wave, self._weights, leg, all_around=self.wants_potential)


def descend_wave(
    wave: Wave, weights: np.ndarray, leg: Leg, all_around: bool = False
) -> Optional[Tuple[np.ndarray, float]]:
    """Return points in metres and the cost of the way down a wave's potential, None where there is none."""
    costmap, grid = leg.costmap, leg.costmap.grid
    if not wave.reach(
        costmap.costs, weights, leg.start_cell, leg.goal_cell, leg.cancelled, costmap.revision, all_around):
        return None
    origin = np.array([grid.origin_x, grid.origin_y])
    start = (np.array(leg.start[:2]) - origin) / grid.resolution
    points = wave.path((float(start[0]), float(start[1]))) * grid.resolution + origin
    points[0] = leg.start[:2]
    return np.vstack((points, leg.goal[:2])), wave.cost_at(float(start[0]), float(start[1]))
