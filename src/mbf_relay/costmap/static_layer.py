"""The static layer: costs from an occupancy map (costmap_2d's StaticLayer)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import LayerContext, MapSource, PlacedLayer
from mbf_relay.geometry import IDENTITY
from mbf_relay.grid import Grid
from mbf_relay.maps import OccupancyMap
from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class StaticLayerParameters(ParameterSet):
    """Parameters of the static layer, by costmap_2d's names."""

    enabled: bool = parameter(True, "use this layer")
    map_topic: str = parameter("map", "topic of the map", is_topic=True)
    first_map_only: bool = parameter(False, "keep the first map and ignore later ones")
    subscribe_to_updates: bool = parameter(False, "also take partial updates of the map from MAP_TOPIC_updates")
    track_unknown_space: bool = parameter(True, "unknown cells of the map stay unknown; false for free")
    use_maximum: bool = parameter(False, "keep the higher cost of this and earlier layers; false replaces theirs")
    lethal_cost_threshold: int = parameter(
        100, "map value from which on a cell is lethal", minimum=0, maximum=100, aliases=("lethal_threshold",))
    unknown_cost_value: int = parameter(-1, "map value that means unknown", minimum=-128, maximum=255)
    trinary_costmap: bool = parameter(
        True, "cells are only free, lethal or unknown; false scales costs with the map's values")


class StaticLayer(PlacedLayer):
    """Turns a map's values into costs.

    Without rolling_window, a costmap takes size, resolution and origin from its first static layer's map. Where the
    map's origin is rotated, that is an upright grid around the whole map; cells beside the map are treated as its
    unknown ones.
    """

    maps_floor = True

    Parameters = StaticLayerParameters
    parameters: StaticLayerParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._map: Optional[OccupancyMap] = None
        self._map_costs = np.zeros((0, 0), dtype=np.uint8)
        self._table = cost_table(parameters)

    @property
    def map_source(self) -> MapSource:
        p = self.parameters
        return MapSource(p.map_topic, p.first_map_only, p.subscribe_to_updates)

    def reconfigure(self, parameters: Any) -> None:
        super().reconfigure(parameters)
        self._table = cost_table(parameters)
        if self._map is not None:
            self._map_costs = self._table[self._map.data.view(np.uint8)]
        self.touch(Window.of(self.grid))

    def resize(self, grid: Grid) -> None:
        self.grid = grid
        self._pending = Window.of(grid)

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        self.resize(grid)

    def set_map(self, occupancy: OccupancyMap) -> None:
        data = np.ascontiguousarray(occupancy.data, dtype=np.int8)
        self._map = OccupancyMap(data, occupancy.resolution, occupancy.origin)
        self._map_costs = self._table[data.view(np.uint8)]
        self.touch(Window.of(self.grid))

    def update_map(self, x: int, y: int, data: np.ndarray) -> None:
        """Take an update of a part of the map; raise ValueError where it does not lie within the map."""
        rows, columns = data.shape
        height, width = self._map_costs.shape
        if self._map is None:
            return
        if x < 0 or y < 0 or x + columns > width or y + rows > height:
            raise ValueError(
                f"map update of {columns} x {rows} cells at ({x}, {y}) does not fit the map of {width} x {height} cells"
            )
        part = np.ascontiguousarray(data, dtype=np.int8)
        self._map.data[y:y + rows, x:x + columns] = part
        self._map_costs[y:y + rows, x:x + columns] = self._table[part.view(np.uint8)]
        self.touch(Window(x, y, x + columns, y + rows) if self._lies_on_grid() else Window.of(self.grid))

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        return window.union(self.take_pending()) if self._map is not None else window

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        if self._map is None:
            return
        if self._lies_on_grid():
            if self.parameters.use_maximum:
                layer_kernels.merge_maximum(costs, self._map_costs, *window)
            else:
                costs[window.slices] = self._map_costs[window.slices]
        else:
            at = self.own_from_costmap
            origin = self._map.origin
            if self._spans_costmap() and not self.parameters.use_maximum:
                costs[window.slices] = self._table[self.parameters.unknown_cost_value % 256]
            # in the map's own axes, since its origin may be rotated
            in_cells = origin.inverse().compose(at)
            layer_kernels.sample_map(
                costs, *window, self.grid.origin_x, self.grid.origin_y, self.grid.resolution, self._map_costs, 0.0, 0.0,
                self._map.resolution, in_cells.x, in_cells.y, in_cells.theta, self.parameters.use_maximum)

    def _lies_on_grid(self) -> bool:
        """Return whether the map's cells coincide with the costmap's, as when it gave the costmap its size."""
        return self._map is not None and self._map.origin.theta == 0.0 and self._spans_costmap()

    def _spans_costmap(self) -> bool:
        """Return whether the costmap is the upright grid around this map, as when it gave the costmap its size."""
        return (self._map is not None and self.grid == self._map.upright_grid
                and not self.rolling and self.own_from_costmap == IDENTITY)

    def missing_input(self) -> Optional[str]:
        return None if self._map is not None else f"no map has come on topic '{self.parameters.map_topic}'"


def cost_table(parameters: StaticLayerParameters) -> np.ndarray:
    """Return the cost of each map value, indexed by the value as an unsigned byte: shape (256,), uint8."""
    values = np.arange(256)
    threshold = parameters.lethal_cost_threshold
    if parameters.trinary_costmap or threshold == 0:
        costs = np.full(256, FREE_SPACE, dtype=np.uint8)
    else:
        costs = np.minimum(values / threshold * LETHAL, LETHAL).astype(np.uint8)
    costs[values >= threshold] = LETHAL
    costs[parameters.unknown_cost_value % 256] = NO_INFORMATION if parameters.track_unknown_space else FREE_SPACE
    return costs
