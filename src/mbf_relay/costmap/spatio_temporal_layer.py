"""Obstacles that decay with time (spatio_temporal_voxel_layer's SpatioTemporalVoxelLayer)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Dict, Mapping, Type

import numpy as np

from mbf_relay.costmap.cost_grid import LETHAL, Window
from mbf_relay.costmap.layer import LayerContext, shifted
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.costmap.obstacle_layer import ObstacleLayer, ObstacleLayerParameters
from mbf_relay.grid import Grid
from mbf_relay.parameters import parameter, without_effect
from mbf_relay.timing import SET_BACK

LINEAR, EXPONENTIAL, PERSISTENT = 0, 1, -1
"""Values of decay_model."""
NEVER = -np.inf
"""Time (s) at which cells without observations were last seen."""


FRUSTUM = "rays free what they pass, and there is no frustum"
ALL_POINTS = "every point of the newest message is used"


@dataclass(frozen=True)
class SpatioTemporalSourceParameters(SourceParameters):
    """Parameters of one sensor of an obstacle layer; from enabled on, the spatio-temporal layer's alone."""

    enabled: bool = without_effect(True, "leave the source out of observation_sources instead")
    min_z: float = without_effect(0.0, FRUSTUM, unit="m")
    max_z: float = without_effect(10.0, FRUSTUM, unit="m")
    vertical_fov_angle: float = without_effect(0.7, FRUSTUM, unit="rad")
    vertical_fov_padding: float = without_effect(0.0, FRUSTUM, unit="m")
    horizontal_fov_angle: float = without_effect(1.04, FRUSTUM, unit="rad")
    decay_acceleration: float = without_effect(0.0, FRUSTUM, unit="1/s^2")
    model_type: int = without_effect(0, FRUSTUM)
    voxel_filter: bool = without_effect(False, ALL_POINTS)
    filter: str = without_effect("passthrough", ALL_POINTS)
    voxel_min_points: int = without_effect(0, ALL_POINTS)
    clear_after_reading: bool = without_effect(False, "an obstacle is last seen when its message was measured")


@dataclass(frozen=True)
class SpatioTemporalLayerParameters(ObstacleLayerParameters):
    """Parameters of the spatio-temporal layer, by spatio_temporal_voxel_layer's names; each source has its own group.
    """

    source_defaults: ClassVar[Mapping[str, Any]] = {
        "data_type": "PointCloud2", "obstacle_range": 3.0, "max_obstacle_height": 3.0}
    source_kind: ClassVar[Type[SourceParameters]] = SpatioTemporalSourceParameters

    voxel_decay: float = parameter(
        -1.0, "how long an obstacle out of sight is kept, with decay_model 0; below 0 until a ray frees it", unit="s")
    decay_model: int = parameter(
        LINEAR, "0: forget an obstacle after voxel_decay; 1 and -1: keep it until a ray frees it",
        choices=(LINEAR, EXPONENTIAL, PERSISTENT))
    footprint_clearing_enabled: bool = parameter(
        True, "free the cells under the robot's footprint", aliases=("update_footprint_enabled",))
    max_obstacle_height: float = parameter(
        50.0, "points higher than this are not added as obstacles; each source has its own limit too", unit="m",
        minimum=0.0, maximum=50.0)
    voxel_size: float = without_effect(0.05, "cells have the costmap's resolution", unit="m")
    mark_threshold: int = without_effect(0, "one point is enough for an obstacle, as with 0 in C++", minimum=0)
    unknown_threshold: int = without_effect(15, "the C++ layer does not read it either", minimum=0)
    origin_z: float = without_effect(0.0, "the C++ layer does not read it either", unit="m")
    publish_voxel_map: bool = without_effect(False, "there are no voxels to publish")
    mapping_mode: bool = without_effect(False, "there are no voxels to save")
    map_save_duration: float = without_effect(60.0, "there are no voxels to save", unit="s")

    @classmethod
    def deprecated_names(cls, values: Mapping[str, Any]) -> Dict[str, str]:
        """Return nothing: update_footprint_enabled is the C++ layer's own name."""
        return {}


class SpatioTemporalLayer(ObstacleLayer):
    """Marks obstacles, and frees each when no sensor has seen it for `voxel_decay`, whether or not rays pass there.

    This is for depth cameras, which clear nothing where they no longer look or have no reading. Obstacles in the newest
    observation stay, however old it is, as in C++.
    """

    Parameters = SpatioTemporalLayerParameters
    parameters: SpatioTemporalLayerParameters
    notice = (
        "keeps one plane instead of voxels: rays of sources with clearing free the cells they pass, in the place of "
        "frustums, and voxel_decay holds for cells")

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._seen_at = np.zeros((0, 0))  # s, by cell

    @property
    def _forgets(self) -> bool:
        return self.parameters.decay_model == LINEAR and self.parameters.voxel_decay >= 0.0

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        window = super().update_bounds(context, window)
        if self._forgets:
            self._forget(context.now, self._note_what_is_seen(context.now))
        return window.union(self.take_pending())

    def _note_what_is_seen(self, now: float) -> np.ndarray:
        """Record when marked cells were last seen; return those of the kept observations, as row * width + column."""
        seen = [np.empty(0, np.int64)]
        for source in self._sources.values():
            for rays in source.kept if source.parameters.marking else ():
                cells = self.grid.cells_at(rays.marks)
                columns, rows = cells[self.grid.contains_cells(cells)].T
                at = rows * self.grid.width + columns
                self._seen_at.ravel()[at] = np.maximum(self._seen_at.ravel()[at], min(rays.stamp, now))
                if rays.stamp <= now + SET_BACK:
                    seen.append(at)
        return np.concatenate(seen)

    def _forget(self, now: float, shown: np.ndarray) -> None:
        lethal = np.flatnonzero(self.costs == LETHAL)
        age = np.abs(now - self._seen_at.ravel()[lethal])  # time may have been set back since
        gone = np.setdiff1d(lethal[age > self.parameters.voxel_decay], shown)
        if len(gone):
            self.costs.ravel()[gone] = self.default_cost
            self._seen_at.ravel()[gone] = NEVER
            rows, columns = np.divmod(gone, self.grid.width)
            self.touch(Window(int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1))

    def resize(self, grid: Grid) -> None:
        super().resize(grid)
        self._seen_at = np.full(grid.shape if self._forgets else (0, 0), NEVER)

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        super().shift(grid, columns, rows)
        self._seen_at = shifted(self._seen_at, columns, rows, NEVER)
