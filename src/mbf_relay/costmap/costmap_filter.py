"""Nav2's costmap filters: keepout zones and speed limits from a mask, which is an occupancy map of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import LayerContext, MapSource, PlacedLayer, ZoneLimit
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, load_map
from mbf_relay.parameters import TOPIC, ParameterSet, parameter

PERCENT, ABSOLUTE = 1, 2
"""Unit of a speed filter's limits: percent of the top speed, or m/s; numbers as in nav2_msgs/CostmapFilterInfo."""


@dataclass(frozen=True)
class CostmapFilterParameters(ParameterSet):
    """Parameters of a filter, including what Nav2 sends in a CostmapFilterInfo message, which ROS 1 lacks."""

    enabled: bool = parameter(True, "use this filter")
    filter_mask_topic: str = parameter("filter_mask", "topic of the mask, a map as map_server publishes it")
    filter_mask_file: str = parameter(
        "", "the mask's YAML file, read once instead of filter_mask_topic; empty for the topic")
    filter_mask_frame: str = parameter("map", "frame of a mask read from filter_mask_file", is_frame=True)

    def check(self) -> None:
        if not self.filter_mask_file and not TOPIC.fullmatch(self.filter_mask_topic):
            raise ValueError(
                f"parameter filter_mask_topic is {self.filter_mask_topic!r}; it must be a topic's name where "
                "filter_mask_file names no file")


class CostmapFilter(PlacedLayer):
    """A layer with a mask. Until the mask has come the costmap counts as incomplete: the robot does not drive."""

    Parameters = CostmapFilterParameters
    parameters: CostmapFilterParameters
    default_cost = NO_INFORMATION

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.mask: Optional[OccupancyMap] = None
        if parameters.filter_mask_file:
            self.set_map(load_map(parameters.filter_mask_file))

    @property
    def map_source(self) -> Optional[MapSource]:
        return None if self.parameters.filter_mask_file else MapSource(self.parameters.filter_mask_topic)

    @property
    def map_frame(self) -> str:
        return self.parameters.filter_mask_frame if self.parameters.filter_mask_file else ""

    def set_map(self, occupancy: OccupancyMap) -> None:
        self.mask = occupancy
        self.touch(Window.of(self.grid))

    def missing_input(self) -> Optional[str]:
        return None if self.mask is not None else f"no mask has come on topic '{self.parameters.filter_mask_topic}'"


class KeepoutFilter(CostmapFilter):
    """Nav2's KeepoutFilter: cells where the mask is 100 are lethal, and values from 1 to 99 become costs in proportion.

    Listed before the inflation layer, keepout zones are inflated as obstacles are.
    """

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        pending = self.take_pending()
        if not pending.is_empty and self.mask is not None:
            self._draw(self.mask)
        return window.union(pending)

    def _draw(self, mask: OccupancyMap) -> None:
        """Give each of the layer's cells the cost of the mask's cell under its centre."""
        grid, at = self.grid, mask.origin.inverse().compose(self.own_from_costmap)
        self.costs[:] = NO_INFORMATION
        layer_kernels.sample_map(
            self.costs, *Window.of(grid), grid.origin_x, grid.origin_y, grid.resolution,
            keepout_costs()[np.ascontiguousarray(mask.data, dtype=np.int8).view(np.uint8)], 0.0, 0.0, mask.resolution,
            at.x, at.y, at.theta, False)

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        layer_kernels.merge_maximum(costs, self.costs, *window)


def keepout_costs() -> np.ndarray:
    """Return the cost of each value of a mask, indexed by the value as an unsigned byte: shape (256,), uint8."""
    costs = np.full(256, NO_INFORMATION, dtype=np.uint8)
    values = np.arange(FREE + 1, OCCUPIED)
    costs[values] = np.rint(values / OCCUPIED * LETHAL)
    costs[OCCUPIED] = LETHAL
    return costs


@dataclass(frozen=True)
class SpeedFilterParameters(CostmapFilterParameters):
    """Parameters of the speed filter: a zone's limit is base + multiplier * the mask's value."""

    type: int = parameter(
        PERCENT, "unit of the limits: 1 for percent of the controller's top speed, 2 for m/s",
        choices=(PERCENT, ABSOLUTE))
    base: float = parameter(100.0, "limit where the mask is 0, in the unit of `type`")
    multiplier: float = parameter(-1.0, "added to the limit for each step of the mask's value (1 to 100)")


class SpeedFilter(CostmapFilter):
    """Nav2's SpeedFilter: the mask's value under the robot's base limits its speed.

    There is no limit where the value is 0 or unknown, beside the mask, and where the limit comes out at 0 or below.
    Nav2 keeps the previous limit in unknown cells and beside the mask, where it then depends on the robot's way there.
    """

    Parameters = SpeedFilterParameters
    parameters: SpeedFilterParameters

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._limit = ZoneLimit()

    @property
    def zone_limit(self) -> ZoneLimit:
        return self._limit

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        self._limit = self._limit_at(context.robot_pose)
        return window

    def _limit_at(self, pose: Pose2D) -> ZoneLimit:
        """Return the limit with the robot at a pose in the costmap's frame."""
        if self.mask is None:
            return ZoneLimit()
        place = self.own_from_costmap.compose(pose).relative_to(self.mask.origin)
        column, row = self.mask.local_grid.cell_at(place.x, place.y)
        height, width = self.mask.data.shape
        value = int(self.mask.data[row, column]) if 0 <= column < width and 0 <= row < height else UNKNOWN
        limit = self.parameters.base + self.parameters.multiplier * value
        if value in (FREE, UNKNOWN) or limit <= 0.0:
            return ZoneLimit()
        if self.parameters.type == PERCENT:
            return ZoneLimit(math.inf, min(1.0, limit / 100.0))
        return ZoneLimit(limit, 1.0)

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        """Write nothing: the filter only limits speed."""
