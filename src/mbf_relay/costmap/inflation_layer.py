"""The inflation layer: costs that fall off with the distance from obstacles (costmap_2d's InflationLayer)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.costmap import inflation_kernels
from mbf_relay.costmap.cost_grid import FREE_SPACE, INSCRIBED, LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import Layer, LayerContext, shifted
from mbf_relay.distances import distances_to_zeros
from mbf_relay.grid import Grid
from mbf_relay.parameters import ParameterSet, parameter

MAXIMUM_CELLS = inflation_kernels.MAXIMUM_RADIUS
FARTHEST_CELLS = 2048
"""Largest inflation radius (cells): a table of costs then has 4 MB. 100 m at 5 cm, 2 m in the finest costmap."""


@dataclass(frozen=True)
class InflationLayerParameters(ParameterSet):
    """Parameters of the inflation layer, by costmap_2d's names."""

    enabled: bool = parameter(True, "use this layer")
    inflation_radius: float = parameter(
        0.55, "distance from an obstacle up to which cells get a cost", unit="m", minimum=0.0, maximum=50.0)
    cost_scaling_factor: float = parameter(
        10.0, "exponential rate at which costs fall with the distance from the inscribed radius; higher is steeper",
        unit="1/m", minimum=0.0, maximum=100.0)
    inflate_unknown: bool = parameter(
        False, "unknown cells get every inflated cost; false for only those of the inscribed radius")


class InflationLayer(Layer):
    """Raises the costs around lethal cells of the layers listed before it.

    Cells that later layers write are not inflated. Outside of the window of an update, the costmap's own costs include
    those of later layers; so this layer keeps a copy of the costs as earlier layers left them, and inflates that.
    """

    Parameters = InflationLayerParameters
    parameters: InflationLayerParameters
    dynamic_config = "mbf_relay.cfg.InflationLayerConfig"

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._inscribed_radius = 0.0
        self._table, self._radius = np.zeros(1, dtype=np.uint8), 0
        self._redo = True
        self._costs = np.zeros((0, 0), dtype=np.uint8)  # of the earlier layers, inflated

    def _rebuild(self) -> None:
        self._table, self._radius = cost_table(
            self.parameters.inflation_radius, self.parameters.cost_scaling_factor, self._inscribed_radius,
            self.grid.resolution, self.grid.width + self.grid.height)
        self._redo = True

    def reconfigure(self, parameters: Any) -> None:
        super().reconfigure(parameters)
        self._rebuild()

    def resize(self, grid: Grid) -> None:
        super().resize(grid)
        self._costs = np.zeros(grid.shape, dtype=np.uint8)
        self._rebuild()

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        super().shift(grid, columns, rows)
        self._costs = shifted(self._costs, columns, rows, FREE_SPACE)

    def set_footprint(self, inscribed_radius: float) -> None:
        if inscribed_radius != self._inscribed_radius:
            self._inscribed_radius = inscribed_radius
            self._rebuild()

    def cost_at(self, distance: float) -> Optional[int]:
        squared = math.ceil((distance / self.grid.resolution) ** 2 - 1e-9)
        return int(self._table[squared]) if squared < len(self._table) else 0

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        if self._redo:
            self._redo = False
            return Window.of(self.grid)
        return window.grown(self._radius)

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        if self._radius == 0:
            return
        self._costs[window.slices] = costs[window.slices]
        if self._radius > MAXIMUM_CELLS:
            inflate_far(self._costs, window, self._table, self._radius, self.parameters.inflate_unknown)
        else:
            inflation_kernels.inflate(self._costs, *window, self._table, self._radius, self.parameters.inflate_unknown)
        costs[window.slices] = self._costs[window.slices]


def inflate_far(costs: np.ndarray, window: Window, table: np.ndarray, radius: int, inflate_unknown: bool) -> None:
    """Inflate as inflation_kernels.inflate does, for radii above MAXIMUM_CELLS."""
    height, width = costs.shape
    around = Window(*window).grown(radius).within(Grid(1.0, 0.0, 0.0, width, height))
    obstacles = costs[around.slices] == LETHAL
    if not obstacles.any():
        return
    distances = distances_to_zeros(~obstacles, radius)
    inside = window.shifted(-around.x0, -around.y0).slices
    squared = np.rint(np.square(distances[inside], dtype=np.float64)).astype(np.int64)
    raised = np.where(squared < len(table), table[np.minimum(squared, len(table) - 1)], 0)
    old = costs[window.slices]
    unknown = old == NO_INFORMATION
    taken = raised >= (1 if inflate_unknown else INSCRIBED)
    costs[window.slices] = np.where(unknown, np.where(taken, raised, old), np.maximum(old, raised))


def cost_table(
    inflation_radius: float, cost_scaling_factor: float, inscribed_radius: float, resolution: float,
    farthest: int = FARTHEST_CELLS,
) -> Tuple[np.ndarray, int]:
    """Return costmap_2d's inflated costs as a table, and the radius (cells) beyond which all are 0.

    The table, uint8 of shape (radius² + 1,), is indexed by the squared distance in cells. The radius is costmap_2d's,
    or the smaller one at which the costs have fallen to 0.

    Args:
        inflation_radius: Metres.
        cost_scaling_factor: 1/m.
        inscribed_radius: Metres; costs up to there are INSCRIBED.
        resolution: Side of a cell (m).
        farthest: Limit (cells) of the radius, such as the grid's size.
    """
    radius = math.ceil(min(inflation_radius / resolution, farthest, FARTHEST_CELLS))
    metres = np.sqrt(np.arange(radius * radius + 1)) * resolution
    costs = (INSCRIBED - 1) * np.exp(-cost_scaling_factor * np.maximum(0.0, metres - inscribed_radius))
    costs[metres <= inscribed_radius] = INSCRIBED
    costs[0] = LETHAL
    last = int(np.count_nonzero(costs.astype(np.uint8))) - 1  # they fall with the distance
    radius = math.ceil(math.sqrt(last))
    table = np.zeros(radius * radius + 1, dtype=np.uint8)
    table[:last + 1] = costs[:last + 1]
    return table, radius
