"""The abstract layer of a costmap, and base classes for layers with cells of their own."""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Iterable, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.cost_grid import EMPTY, Window
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import OccupancyMap
from mbf_relay.plugins import Plugin
from mbf_relay.tracking.track import Track


@dataclass(frozen=True)
class LayerContext:
    """Arguments of one update of a layer.

    Attributes:
        now: Time (s).
        robot_pose: Pose of the robot's base in the costmap's frame.
        footprint: The robot's outline without padding, shape (K, 2) in metres in the base frame.
    """

    now: float
    robot_pose: Pose2D
    footprint: np.ndarray


class MapSource(NamedTuple):
    """A layer's map: its topic, whether maps after the first are ignored, and whether partial updates are taken."""

    topic: str
    first_only: bool = False
    updates: bool = False


class ZoneLimit(NamedTuple):
    """Speed limits at the robot's place: in m/s, and as a share of the controller's top speeds."""

    speed: float = math.inf
    share: float = 1.0

    @staticmethod
    def lowest(limits: Iterable[ZoneLimit]) -> ZoneLimit:
        """Return the lowest of several limits, in each unit."""
        speeds, shares = zip(ZoneLimit(), *limits)
        return ZoneLimit(min(speeds), min(shares))


class Layer(Plugin, abc.ABC):
    """One source of knowledge about obstacles, which it writes into the costmap's grid.

    In each update the costmap calls, under its lock: `shift`, if a rolling window moved; `update_bounds` of every
    enabled layer; then, after resetting the cells in the union of the windows, `update_costs` of every enabled layer
    for that union. Later layers in the list write over what earlier ones wrote.

    Attributes:
        notice: One line for the log on what users should know of this kind of layer; empty for none.
        maps_floor: Whether its map is a floor plan, as a static layer's, which gives a costmap its size.
        grid: The costmap's present grid.
        rolling: The costmap's rolling_window.
        tracks_unknown: The costmap's track_unknown_space.
        enabled: False for a layer that updates leave out.
    """

    notice: str = ""
    maps_floor: ClassVar[bool] = False
    dynamic_config = "mbf_relay.cfg.CostmapLayerConfig"

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.grid = Grid(1.0, 0.0, 0.0, 0, 0)
        self.rolling = False
        self.tracks_unknown = False

    @property
    def enabled(self) -> bool:
        """Whether updates include the layer: its parameter of that name, true where it has none."""
        return bool(getattr(self.parameters, "enabled", True))

    @property
    def sources(self) -> Mapping[str, Any]:
        """The layer's sensors by name, with their parameters (SourceParameters)."""
        return {}

    @property
    def sensor_patience(self) -> float:
        """Time (s) that observations may wait for a transform, where longer than the costmap's own tolerance."""
        return 0.0

    @property
    def map_source(self) -> Optional[MapSource]:
        """Where the layer's map comes from; None for a layer without one."""
        return None

    @property
    def map_frame(self) -> str:
        """Frame of a map that does not come in a message, as from a file; empty for none."""
        return ""

    @property
    def zone_limit(self) -> ZoneLimit:
        """Speed limits at the place where the robot was at the last update."""
        return ZoneLimit()

    @property
    def tracks(self) -> Optional[Tuple[Track, ...]]:
        """Moving obstacles in the costmap's frame; None for a layer that does not track any."""
        return None

    @property
    def sees_all_round(self) -> bool:
        """Whether its latest observations cover all directions, so that turning on the spot would show nothing new."""
        return False

    def attach(self, rolling: bool, tracks_unknown: bool) -> None:
        """Take the costmap's rolling_window and track_unknown_space; called once, before anything else."""
        self.rolling = rolling
        self.tracks_unknown = tracks_unknown

    def resize(self, grid: Grid) -> None:
        """Take a grid of another size, resolution or origin; the content of cells is lost."""
        self.grid = grid

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        """Take the grid of a rolling window that moved; cells in both windows keep their content.

        Args:
            grid: The grid after the move.
            columns, rows: Cells by which it moved, towards positive x and y.
        """
        self.grid = grid

    def set_footprint(self, inscribed_radius: float) -> None:
        """Take a new inscribed radius (m)."""

    def cost_at(self, distance: float) -> Optional[int]:
        """Return the cost it writes at a distance (m) from an obstacle; None for a layer that does not inflate."""
        return None

    def observe(self, source: str, observation: Observation, now: float) -> Optional[Observation]:
        """Take an observation of one of `sources`. Layers that track moving obstacles are given it before the others.

        Args:
            source: Its name.
            observation: In the costmap's frame; its age counts from its stamp.
            now: Present time (s).

        Returns:
            The observation to give the remaining layers instead; None to leave it as it is.
        """
        return None

    def share(self, other: Layer, frame: Pose2D) -> None:
        """Learn of a layer of another costmap that gets every observation before this one does, to share its results.

        Args:
            other: That layer, of any kind.
            frame: Pose of its costmap's frame in this costmap's frame, which does not change.
        """

    def refuse(self, source: str, reason: str, is_blind: bool) -> None:
        """Record why a message of one of `sources` was not used.

        Args:
            source: Its name.
            reason: Text for `stale_reason`.
            is_blind: Whether the message shows that the sensor sees nothing. Then the layer is stale at once, until its
                next observation.
        """

    def set_map(self, occupancy: OccupancyMap) -> None:
        """Take the layer's map."""

    def update_map(self, x: int, y: int, data: np.ndarray) -> None:
        """Take an update of a part of the map.

        Args:
            x, y: Column and row of its lower left cell in the map.
            data: int8 of shape (rows, columns).
        """

    def set_map_from_costmap(self, transform: Pose2D) -> None:
        """Take the transform that brings poses in the costmap's frame to the map's."""

    @abc.abstractmethod
    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        """Update the layer and return `window` widened by the cells whose costs may have changed.

        Args:
            context: Time, robot pose and footprint.
            window: The union of what the layers before it returned. All of it is redone, whatever this layer returns.
        """

    @abc.abstractmethod
    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        """Write into a window of `costs`, shape (height, width), uint8; cells outside of it may only be read."""

    def clear(self, window: Window, inside: bool) -> None:
        """Clear observed obstacles inside of a window, or outside of it; what comes from a map stays."""

    def max_age(self, source: str) -> float:
        """Return the age (s) above which observations of one of `sources` are useless; 0 for no limit."""
        return 0.0

    def stale_reason(self, now: float) -> Optional[str]:
        """Return why the layer is not up to date at time `now` (s), or None; by default its `missing_input`."""
        return self.missing_input()

    def missing_input(self) -> Optional[str]:
        """Return which necessary input, such as a map, has not come yet, or None."""
        return None


def missing_inputs(layers: Iterable[Layer]) -> str:
    """Return the missing inputs of all enabled layers, separated by semicolons; empty for none."""
    return "; ".join(filter(None, (layer.missing_input() for layer in layers if layer.enabled)))


class CellLayer(Layer):
    """A layer with costs of its own, one per cell, that collects the windows in which they changed.

    Attributes:
        costs: Shape (height, width), uint8; NO_INFORMATION where the layer writes nothing.
        default_cost: Cost of cells without observations.
    """

    default_cost = 0

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.costs = np.zeros((0, 0), dtype=np.uint8)
        self._pending = EMPTY

    def resize(self, grid: Grid) -> None:
        super().resize(grid)
        self.costs = np.full(grid.shape, self.default_cost, dtype=np.uint8)
        self._pending = Window.of(grid)

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        super().shift(grid, columns, rows)
        self.costs = shifted(self.costs, columns, rows, self.default_cost)
        self._pending = Window.of(grid)

    def touch(self, window: Window) -> None:
        """Add a window to what the next update redoes."""
        self._pending = self._pending.union(window.within(self.grid))

    def take_pending(self) -> Window:
        """Return the window collected by `touch`, `shift` and `resize` since the last call."""
        pending, self._pending = self._pending, EMPTY
        return pending


class PlacedLayer(CellLayer):
    """A layer whose content, such as a map, lies in a frame of its own and is not cleared as observations are.

    Attributes:
        own_from_costmap: Transform that brings poses in the costmap's frame to that frame.
    """

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.own_from_costmap = IDENTITY

    def set_map_from_costmap(self, transform: Pose2D) -> None:
        if transform != self.own_from_costmap:
            self.own_from_costmap = transform
            self.touch(Window.of(self.grid))

    def clear(self, window: Window, inside: bool) -> None:
        """Do nothing: the content does not come from observations."""


def shifted(costs: np.ndarray, columns: int, rows: int, fill: float) -> np.ndarray:
    """Return an array over a window after the window moved.

    Args:
        costs: Shape (height, width), of any type, before the move.
        columns, rows: Cells by which the window moved, towards positive x and y.
        fill: Value of cells that are new in the window.
    """
    height, width = costs.shape
    result = np.full_like(costs, fill)
    x0, x1 = max(columns, 0), min(width + columns, width)
    y0, y1 = max(rows, 0), min(height + rows, height)
    if x0 < x1 and y0 < y1:
        result[y0 - rows:y1 - rows, x0 - columns:x1 - columns] = costs[y0:y1, x0:x1]
    return result


def changed_window(before: np.ndarray, costs: np.ndarray, window: Window) -> Window:
    """Return the smallest window that holds the cells of `window` whose costs changed.

    Args:
        before: The window's costs before, shape (rows, columns) of the window.
        costs: The whole grid's costs now, shape (height, width).
        window: Not empty, and within the grid.
    """
    return Window(*layer_kernels.changed_part(before, costs, window.x0, window.y0))


def tracks_of(layers: Iterable[Layer]) -> Optional[Tuple[Track, ...]]:
    """Return the moving obstacles of all enabled layers; None where no layer tracks any."""
    known = [layer.tracks for layer in layers if layer.enabled]
    looked_for = [tracks for tracks in known if tracks is not None]
    return tuple(track for tracks in looked_for for track in tracks) if looked_for else None
