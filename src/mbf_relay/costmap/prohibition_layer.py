"""Prohibited areas listed in parameters (costmap_prohibition_layer's CostmapProhibitionLayer)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import LayerContext, PlacedLayer
from mbf_relay.grid import Grid
from mbf_relay.parameters import LARGEST, ParameterSet, parameter

MOST_CORNERS = 10000
"""Corners that all areas may have together."""


@dataclass(frozen=True)
class ProhibitionLayerParameters(ParameterSet):
    """Parameters of the prohibition layer, by costmap_prohibition_layer's names."""

    enabled: bool = parameter(True, "use this layer")
    prohibition_areas: Any = parameter(
        (), "list of points [x, y], lines [[x, y], [x, y]] and polygons of three or more corners, in metres")
    fill_polygons: bool = parameter(True, "prohibit the inside of polygons too; false for only their outlines")
    prohibition_frame: str = parameter(
        "map", "frame of the areas; the C++ layer takes the costmap's, in which they drift if it is odom",
        is_frame=True)

    def check(self) -> None:
        """Raise ValueError for an entry that is no area; the text names it."""
        areas_of(self.prohibition_areas)


class ProhibitionLayer(PlacedLayer):
    """Makes prohibited areas lethal. Listed before the inflation layer, they are inflated as obstacles are."""

    Parameters = ProhibitionLayerParameters
    parameters: ProhibitionLayerParameters
    default_cost = NO_INFORMATION

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._areas = areas_of(parameters.prohibition_areas)

    @property
    def map_frame(self) -> str:
        return self.parameters.prohibition_frame if self._areas else ""

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        pending = self.take_pending()
        if not pending.is_empty:
            self.costs.fill(NO_INFORMATION)
            placed = self.own_from_costmap.inverse()
            for area in self._areas:
                self._draw(placed.transform_points(area))
        return window.union(pending)

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        layer_kernels.merge_maximum(costs, self.costs, *window)

    def _draw(self, corners: np.ndarray) -> None:
        """Mark an area by its corners, (K, 2) in the costmap's frame: one for a point, two for a line."""
        grid = self.grid
        for begin, end in zip(corners, np.roll(corners, -1, axis=0)):
            ends = clipped(begin, end, grid)
            if ends is None:
                continue
            begin, end = ends
            steps = 2 + int(2.0 * float(np.hypot(*(end - begin))) / grid.resolution)
            cells = grid.cells_at(begin + np.linspace(0.0, 1.0, steps)[:, None] * (end - begin))
            inside = ((cells >= 0) & (cells < (grid.width, grid.height))).all(axis=1)
            self.costs[cells[inside, 1], cells[inside, 0]] = LETHAL
        if len(corners) < 3 or not self.parameters.fill_polygons:
            return
        window = Window.over(grid, corners.min(axis=0), corners.max(axis=0)).within(grid)
        if window.is_empty:
            return
        rows, columns = np.ogrid[window.slices]
        x, y = grid.origin_x + (columns + 0.5) * grid.resolution, grid.origin_y + (rows + 0.5) * grid.resolution
        within = np.zeros(np.broadcast(x, y).shape, dtype=bool)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0)):  # even-odd rule
            if y0 != y1:
                within ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        self.costs[window.slices][within] = LETHAL


def clipped(begin: np.ndarray, end: np.ndarray, grid: Grid) -> Optional[Tuple[np.ndarray, np.ndarray]]:
    """Return the part of a line from `begin` to `end`, (2,) in metres, that may lie in a grid; None where none does.

    An axis-parallel line beside the grid is not always left out.
    """
    low = np.array([grid.origin_x, grid.origin_y])
    high, way = low + grid.resolution * np.array([grid.width, grid.height]), end - begin
    first, last = 0.0, 1.0
    for axis in range(2):
        if way[axis] != 0.0:
            shares = sorted(((low[axis] - begin[axis]) / way[axis], (high[axis] - begin[axis]) / way[axis]))
            first, last = max(first, shares[0]), min(last, shares[1])
    return (begin + first * way, begin + last * way) if first <= last else None


def areas_of(listed: Any) -> List[np.ndarray]:
    """Return the corners of each area of a list, (K, 2) in metres.

    Raises:
        ValueError: It is no list, has too many corners, or one of its entries is no area; the text names it.
    """
    if not isinstance(listed, (list, tuple)):
        raise ValueError(f"parameter prohibition_areas is {listed!r}; it must be a list")
    areas = []
    for index, entry in enumerate(listed):
        is_point = isinstance(entry, (list, tuple)) and len(entry) > 0 and not isinstance(entry[0], (list, tuple))
        try:
            corners = np.array([entry] if is_point else entry, dtype=np.float64)
        except (TypeError, ValueError):
            corners = np.zeros(0)
        if corners.ndim != 2 or corners.shape[1] not in (2, 3) or not len(corners):
            raise ValueError(
                f"parameter prohibition_areas[{index}] is {entry!r}; it must be a point [x, y] or a list of points")
        if not (np.isfinite(corners).all() and (np.abs(corners) <= LARGEST).all()):
            raise ValueError(
                f"parameter prohibition_areas[{index}] is {entry!r}; its coordinates must be finite metres")
        areas.append(corners[:, :2])
    if sum(map(len, areas)) > MOST_CORNERS:
        raise ValueError(f"parameter prohibition_areas has {sum(map(len, areas))} corners; at most {MOST_CORNERS}")
    return areas
