"""The abstract layer: one source of knowledge about obstacles."""

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
    """What a layer may know in one update.

    Attributes:
        now: Time (s).
        robot_pose: The robot's base in the costmap's frame.
        footprint: What the robot takes up: its outline without padding, shape (K, 2) in metres in the base frame.
    """

    now: float
    robot_pose: Pose2D
    footprint: np.ndarray


class MapSource(NamedTuple):
    """Where a layer's map comes from: its topic, whether to keep the first, and to take changed parts of it."""

    topic: str
    first_only: bool = False
    updates: bool = False


class ZoneLimit(NamedTuple):
    """How fast the robot may go where it stands: metres per second, and the share of its controller's top speeds."""

    speed: float = math.inf
    share: float = 1.0

    @staticmethod
    def lowest(limits: Iterable[ZoneLimit]) -> ZoneLimit:
        """Return what several limits leave together."""
        speeds, shares = zip(ZoneLimit(), *limits)
        return ZoneLimit(min(speeds), min(shares))


class Layer(Plugin, abc.ABC):
    """Writes what it knows into the costmap's grid.

    The costmap calls it, under its lock, in this order per update: `shift` where a rolling window moved,
    `update_bounds` of every layer, then `update_costs` of every layer over the union of the windows, whose cells were
    reset before. Layers write over what earlier layers in the list wrote.

    Attributes:
        notice: What users should know of this kind of layer, one line for the log; empty where there is nothing.
        maps_floor: Whether its map is the floor's, whose size a costmap takes that is no rolling window.
        grid: Where the costmap's cells lie at present.
        enabled: A layer that is not is passed over.
    """

    notice: ClassVar[str] = ""
    maps_floor: ClassVar[bool] = False
    dynamic_config = "mbf_relay.cfg.CostmapLayerConfig"

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.grid = Grid(1.0, 0.0, 0.0, 0, 0)
        self.rolling = False
        self.tracks_unknown = False

    @property
    def enabled(self) -> bool:
        """Whether the layer takes part; from its parameter of that name where it has one."""
        return bool(getattr(self.parameters, "enabled", True))

    @property
    def sources(self) -> Mapping[str, Any]:
        """The layer's sensors by name, with their parameters (SourceParameters)."""
        return {}

    @property
    def sensor_patience(self) -> float:
        """How long (s) what its sensors saw may wait for a transform, where that is longer than the costmap's own."""
        return 0.0

    @property
    def map_source(self) -> Optional[MapSource]:
        """Where the layer's map comes from; None for a layer without one."""
        return None

    @property
    def map_frame(self) -> str:
        """Frame of a map that comes by no message; empty where there is none."""
        return ""

    @property
    def zone_limit(self) -> ZoneLimit:
        """How fast the robot may go where it stood at the last update."""
        return ZoneLimit()

    @property
    def tracks(self) -> Optional[Tuple[Track, ...]]:
        """What it knows that moves, in the costmap's frame; None where it does not look for that."""
        return None

    @property
    def sees_all_round(self) -> bool:
        """Whether what it was shown last came from all directions: a robot that turns on the spot shows it no more."""
        return False

    def attach(self, rolling: bool, tracks_unknown: bool) -> None:
        """Learn what the costmap is like; called once, before anything else."""
        self.rolling = rolling
        self.tracks_unknown = tracks_unknown

    def resize(self, grid: Grid) -> None:
        """Take a new size, resolution or place; what was known of cells is lost."""
        self.grid = grid

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        """Take a window that moved by whole cells; cells in both windows keep what was known of them."""
        self.grid = grid

    def set_footprint(self, inscribed_radius: float) -> None:
        """Take a new inscribed radius (m)."""

    def cost_at(self, distance: float) -> Optional[int]:
        """Return the cost it writes so far (m) from an obstacle; None of a layer that writes none round obstacles."""
        return None

    def observe(self, source: str, observation: Observation, now: float) -> Optional[Observation]:
        """Take what one of `sources` saw, at `now` (s); its age counts from its stamp.

        Layers that look for what moves are told first.

        Returns:
            What the other layers are to be told in its place; None where it is to stay as it is.
        """
        return None

    def share(self, other: Layer, frame: Pose2D) -> None:
        """Learn of a layer of another costmap that is always shown the same before this one is.

        What both would find in it need not be found twice.

        Args:
            other: That layer, of whatever kind.
            frame: Where its costmap's frame lies, and stays, in this one's.
        """

    def refuse(self, source: str, reason: str, is_blind: bool) -> None:
        """Take note why a message of one of `sources` is not used.

        Args:
            source: Its name.
            reason: Told where it is stale.
            is_blind: It shows that the sensor sees nothing: stale at once, until it is observed again.
        """

    def set_map(self, occupancy: OccupancyMap) -> None:
        """Take the layer's map."""

    def update_map(self, x: int, y: int, data: np.ndarray) -> None:
        """Take a changed part of the map: int8 of shape (rows, columns) with its lower left cell at (x, y)."""

    def set_map_from_costmap(self, transform: Pose2D) -> None:
        """Take the transform from the costmap's frame to the map's."""

    @abc.abstractmethod
    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        """Bring the layer up to date and return `window` widened by the cells whose costs this may change.

        What `window` holds is redone also where it is not in what is returned: other layers have something there.
        """

    @abc.abstractmethod
    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        """Write into the window of `costs`, shape (height, width), uint8; cells outside may be read only."""

    def clear(self, window: Window, inside: bool) -> None:
        """Forget what was observed inside of a window, or outside of it; what a map says stays."""

    def max_age(self, source: str) -> float:
        """Return the age (s) from which what one of `sources` measured says nothing any more; 0 for never."""
        return 0.0

    def stale_reason(self, now: float) -> Optional[str]:
        """Return what the layer waits for, or None where it may be relied on; by default what it has never had."""
        return self.missing_input()

    def missing_input(self) -> Optional[str]:
        """Return what the layer has never had and shows nothing without, or None."""
        return None


def missing_inputs(layers: Iterable[Layer]) -> str:
    """Return what those of the layers that are on have never had and show nothing without; empty for nothing."""
    return "; ".join(filter(None, (layer.missing_input() for layer in layers if layer.enabled)))


class CellLayer(Layer):
    """A layer that keeps costs of its own, one per cell, and notes where they changed.

    Attributes:
        costs: Shape (height, width), uint8; NO_INFORMATION where the layer says nothing.
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
        """Have the next update redo a window."""
        self._pending = self._pending.union(window.within(self.grid))

    def take_pending(self) -> Window:
        """Return what `touch` collected since the last call."""
        pending, self._pending = self._pending, EMPTY
        return pending


class PlacedLayer(CellLayer):
    """A layer of what lies in a frame of its own, as maps do, and is not forgotten with what was observed.

    Attributes:
        own_from_costmap: Takes poses in the costmap's frame to that one.
    """

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.own_from_costmap = IDENTITY

    def set_map_from_costmap(self, transform: Pose2D) -> None:
        if transform != self.own_from_costmap:
            self.own_from_costmap = transform
            self.touch(Window.of(self.grid))

    def clear(self, window: Window, inside: bool) -> None:
        """Nothing of it was observed."""


def shifted(costs: np.ndarray, columns: int, rows: int, fill: float) -> np.ndarray:
    """Return an array over a window that moved by `columns` and `rows`; cells new in it are `fill`."""
    height, width = costs.shape
    result = np.full_like(costs, fill)
    x0, x1 = max(columns, 0), min(width + columns, width)
    y0, y1 = max(rows, 0), min(height + rows, height)
    if x0 < x1 and y0 < y1:
        result[y0 - rows:y1 - rows, x0 - columns:x1 - columns] = costs[y0:y1, x0:x1]
    return result


def changed_window(before: np.ndarray, costs: np.ndarray, window: Window) -> Window:
    """Return the smallest window that holds the cells of `window` in which `costs` are not what they were `before`.

    Args:
        before: The window's cells, in an array of their own.
        costs: The whole grid.
        window: Part of it that is not empty.
    """
    return Window(*layer_kernels.changed_part(before, costs, window.x0, window.y0))


def tracks_of(layers: Iterable[Layer]) -> Optional[Tuple[Track, ...]]:
    """Return what moves, as all layers that take part know it; None where none looks for that."""
    known = [layer.tracks for layer in layers if layer.enabled]
    looked_for = [tracks for tracks in known if tracks is not None]
    return tuple(track for tracks in looked_for for track in tracks) if looked_for else None
