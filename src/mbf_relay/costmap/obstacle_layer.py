"""Obstacles marked and cleared by lidars and depth cameras (costmap_2d's ObstacleLayer and VoxelLayer)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Dict, List, Mapping, Optional, Tuple, Type, TypeVar

import numpy as np

from mbf_relay.costmap import footprint_kernels, layer_kernels
from mbf_relay.costmap.cost_grid import EMPTY, FREE_SPACE, LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import CellLayer, LayerContext, changed_window
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.observation_source import RANGE, ObservationSource, RayBundle, SourceParameters
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.parameters import ParameterSet, parameter, without_effect

OVERWRITE, MAXIMUM, NOTHING = 0, 1, 99
"""Values of combination_method, as in costmap_2d."""

UNSEEN = 0.1
"""Angle (rad) between neighbouring rays above which the sensors do not cover all directions."""

S = TypeVar("S", bound="ObstacleLayerParameters")

RECONFIGURABLE = ("enabled", "footprint_clearing_enabled", "max_obstacle_height", "combination_method")
"""What can be changed at run time, as in costmap_2d."""


@dataclass(frozen=True)
class ObstacleLayerParameters(ParameterSet):
    """Parameters of the obstacle layer, by costmap_2d's names; each source has a group of its own beside them."""

    enabled: bool = parameter(True, "use this layer")
    observation_sources: str = parameter("", "names of the sensors, separated by spaces; each has a group of its name")
    footprint_clearing_enabled: bool = parameter(True, "free the cells under the robot's footprint")
    max_obstacle_height: float = parameter(
        2.0, "points higher than this are not added as obstacles", unit="m", minimum=0.0, maximum=50.0)
    combination_method: int = parameter(
        1, "0: overwrite the layers before; 1: keep the higher cost; 99: change nothing",
        choices=(OVERWRITE, MAXIMUM, NOTHING))
    track_unknown_space: bool = parameter(False, "cells that no ray has passed are unknown; false for free")
    transform_tolerance: float = parameter(
        0.2, "how long an observation waits for its transform", unit="s", minimum=0.0, maximum=10.0)
    source_timeout: float = parameter(
        1.0, "longest time without a scan before the costmap is stale, for LaserScan sources with expected_update_rate "
        "0; it is stale earlier if more than one scan is missing; 0 for never", unit="s", minimum=0.0)
    source_parameters: Mapping[str, SourceParameters] = parameter({}, "read from the sources' groups; not to be set")

    source_defaults: ClassVar[Mapping[str, Any]] = {}
    """Defaults of this layer's sources that differ from those of `source_kind`."""
    source_kind: ClassVar[Type[SourceParameters]] = SourceParameters
    """Class of its sources' parameters."""

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the layer's own values, and as `source_parameters` those of its sources' groups."""
        sources = {name: source for name, (source, _notes) in cls._sources_in(values).items()}
        return {**super().known(values), "source_parameters": sources}

    @classmethod
    def groups(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names of the sources."""
        return str(values.get("observation_sources", "")).split()

    @classmethod
    def read(cls: Type[S], values: Mapping[str, Any]) -> Tuple[S, List[str]]:
        """Read the parameters as ParameterSet.read does, with notes on the sources' values as well."""
        parameters, notes = super().read(values)
        for name, (_source, of_source) in cls._sources_in(values).items():
            notes += [f"observation source '{name}': {note}" for note in of_source]
        return parameters, notes

    @classmethod
    def _sources_in(cls, values: Mapping[str, Any]) -> Dict[str, Tuple[SourceParameters, List[str]]]:
        """Return the parameters in each source's group, and the notes on them."""
        above = {key: values[key] for key in ("obstacle_range", "raytrace_range") if key in values}
        inherited = {**cls.source_defaults, **above}
        sources = {}
        for name in cls.groups(values):
            group = values.get(name, {})
            if not isinstance(group, Mapping):
                raise ValueError(
                    f"parameter {name} is {group!r}; it must be the group of the observation source's parameters"
                )
            try:
                source, notes = cls.source_kind.read({**inherited, **group})
                if source.data_type == RANGE:
                    raise ValueError("its data_type is Range, which range_sensor_layer::RangeSensorLayer takes")
            except ValueError as error:
                raise ValueError(f"observation source '{name}': {error}") from error
            sources[name] = source.replace(topic=source.topic or name), notes
        return sources


class ObstacleLayer(CellLayer):
    """Keeps observed obstacles: cells hit by rays are lethal, until a ray passes them and frees them."""

    Parameters = ObstacleLayerParameters
    parameters: ObstacleLayerParameters
    dynamic_config = "mbf_relay.cfg.ObstacleLayerConfig"

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.default_cost = NO_INFORMATION if parameters.track_unknown_space else FREE_SPACE
        self._sources = {key: ObservationSource(value) for key, value in parameters.source_parameters.items()}
        self._drawn: List[RayBundle] = []  # observations the cells already show
        self._freed = EMPTY  # where the robot stood at the last update
        self._outline, self._outline_reach = np.zeros((0, 2)), 0.0  # the footprint, and its circumscribed radius (m)

    @property
    def sources(self) -> Mapping[str, SourceParameters]:
        return self.parameters.source_parameters

    @property
    def sensor_patience(self) -> float:
        return self.parameters.transform_tolerance

    @property
    def highest_mark(self) -> float:
        """Height (m) above which points do not become obstacles."""
        return self.parameters.max_obstacle_height

    @property
    def sees_all_round(self) -> bool:
        rays = [one for source in self._sources.values() if source.parameters.clearing for one in source.kept]
        if not rays:
            return False
        bearings = np.sort(np.concatenate([np.arctan2(one.ends[:, 1] - one.y, one.ends[:, 0] - one.x) for one in rays]))
        gaps = np.diff(bearings, append=bearings[:1] + 2.0 * math.pi)
        return bool(len(gaps)) and float(gaps.max()) <= UNSEEN

    def observe(self, source: str, observation: Observation, now: float) -> None:
        self._sources[source].add(observation, now, self.highest_mark)

    def refuse(self, source: str, reason: str, is_blind: bool) -> None:
        if is_blind:
            self._sources[source].trouble = reason
        else:
            self._sources[source].unused = reason

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        kept = [(source.parameters, source.kept) for source in self._sources.values()]
        clearing = [rays for parameters, bundles in kept if parameters.clearing for rays in bundles]
        marking = [rays for parameters, bundles in kept if parameters.marking for rays in bundles]
        stands = self.parameters.footprint_clearing_enabled
        observed = [rays for _, bundles in kept for rays in bundles]
        if observed == self._drawn:
            observed = clearing = []  # nothing new to clear; only the robot may have moved
        else:
            self._drawn = observed
        left, self._freed = self._freed, self._stood_on(context) if stands else EMPTY
        touched = self._touched(observed, left.union(self._freed))  # marks under its last footprint show again
        if touched.is_empty:
            return window.union(self.take_pending())
        before = self.costs[touched.slices].copy()
        grid = (self.grid.origin_x, self.grid.origin_y, self.grid.resolution)
        for rays in clearing:
            reach = math.ceil(rays.reach / self.grid.resolution)
            unseen = self._lift_unseen(rays)
            layer_kernels.clear_rays(self.costs, *grid, rays.x, rays.y, rays.ends, float(reach))
            self.costs.ravel()[unseen] = LETHAL
        for rays in marking:
            layer_kernels.mark_points(self.costs, *grid, rays.marks)
        if stands:  # last, so that hits on the robot itself, as on a mast, do not stay
            free_within(self.grid, self.costs, context.footprint, context.robot_pose)
        self.touch(changed_window(before, self.costs, touched))
        return window.union(self.take_pending())

    def _lift_unseen(self, rays: RayBundle) -> np.ndarray:
        """Remove obstacles that beams without a valid reading may be hitting, and return their cells, to be put back.

        A lidar does not see what is nearer than range_min; rays that pass beside such an obstacle would clear it.

        Returns:
            Shape (K,), int64: row * width + column.
        """
        if len(rays.unseen) == 0:
            return np.empty(0, np.int64)
        grid = self.grid
        longest = float(np.hypot(rays.unseen[:, 0] - rays.x, rays.unseen[:, 1] - rays.y).max())
        found = np.empty(min(self.costs.size, (2 * math.ceil(longest / grid.resolution) + 5) ** 2), np.int64)
        number = layer_kernels.lift_lethal(
            self.costs, grid.origin_x, grid.origin_y, grid.resolution, rays.x, rays.y, rays.unseen, found)
        return found[:number]

    def _stood_on(self, context: LayerContext) -> Window:
        """Return a window that holds every cell under the footprint, at any heading."""
        if context.footprint is not self._outline:
            self._outline = context.footprint
            self._outline_reach = float(np.hypot(self._outline[:, 0], self._outline[:, 1]).max(initial=0.0))
        x, y, _ = context.robot_pose
        return Window.around(self.grid, x, y, self._outline_reach).grown(1)

    def _touched(self, observations: List[RayBundle], stood_on: Window) -> Window:
        """Return `stood_on` widened by every cell the observations may change, cut to the grid."""
        touched = stood_on
        for rays in observations:  # one may end a cell further
            touched = touched.union(Window.over(self.grid, rays.low, rays.high).grown(2))
        return touched.within(self.grid)

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        if self.parameters.combination_method == OVERWRITE:
            layer_kernels.merge_overwrite(costs, self.costs, *window)
        elif self.parameters.combination_method == MAXIMUM:
            layer_kernels.merge_maximum(costs, self.costs, *window)

    def resize(self, grid: Grid) -> None:
        super().resize(grid)
        self._drawn = []

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        super().shift(grid, columns, rows)
        self._drawn = []

    def clear(self, window: Window, inside: bool) -> None:
        self._drawn = []
        window = window.within(self.grid)
        if inside:
            if not window.is_empty:
                self.costs[window.slices] = self.default_cost
                self.touch(window)
            return
        kept = self.costs[window.slices].copy()
        self.costs.fill(self.default_cost)
        self.costs[window.slices] = kept
        self.touch(Window.of(self.grid))

    def max_age(self, source: str) -> float:
        parameters = self._sources[source].parameters
        limit = parameters.expected_update_rate
        return self.parameters.source_timeout if limit == 0.0 and parameters.data_type == "LaserScan" else limit

    def stale_reason(self, now: float) -> Optional[str]:
        reasons = (source.stale_reason(name, self.max_age(name), now) for name, source in self._sources.items())
        return next((reason for reason in reasons if reason is not None), None)


def free_within(grid: Grid, costs: np.ndarray, footprint: np.ndarray, pose: Pose2D) -> None:
    """Set the cells that lie wholly within a convex footprint to FREE_SPACE.

    Cells that the outline crosses may hold an obstacle right beside the robot and stay; costmap_2d frees them too.

    Args:
        grid: The cells' grid.
        costs: Shape (height, width), uint8.
        footprint: Corners in the base frame, shape (K, 2) in metres with K > 2.
        pose: Pose of the base in the grid's frame.
    """
    footprint_kernels.free_within(
        costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(footprint, dtype=np.float64), *pose)


VOXEL_RECONFIGURABLE = RECONFIGURABLE + (
    "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold")
"""What can be changed at run time, as in costmap_2d."""


@dataclass(frozen=True)
class VoxelLayerParameters(ObstacleLayerParameters):
    """Parameters of the obstacle layer and, from `origin_z` on, the voxel layer; each source has its own group."""

    origin_z: float = parameter(0.0, "height of the lowest voxel's lower side", unit="m")
    z_resolution: float = parameter(0.2, "height of a voxel", unit="m", above=0.0, maximum=50.0)
    z_voxels: int = parameter(
        10, "number of voxels in a column; points above the highest are not added as obstacles", minimum=0)
    unknown_threshold: int = without_effect(15, "a cell is known or unknown as a whole column", minimum=0)
    mark_threshold: int = without_effect(0, "one point is enough for an obstacle, as with 0 in costmap_2d", minimum=0)
    publish_voxel_map: bool = without_effect(False, "there are no voxels to publish")


class VoxelLayer(ObstacleLayer):
    """Marks points up to the top of the highest voxel; rays of any height free the cells they pass."""

    Parameters = VoxelLayerParameters
    parameters: VoxelLayerParameters
    dynamic_config = "mbf_relay.cfg.VoxelLayerConfig"

    notice = (
        "keeps one plane instead of voxels: points from min_obstacle_height to the highest voxel's top mark a cell, "
        "and rays of any height free it")

    @property
    def highest_mark(self) -> float:
        parameters = self.parameters
        return min(parameters.max_obstacle_height, parameters.origin_z + parameters.z_voxels * parameters.z_resolution)
