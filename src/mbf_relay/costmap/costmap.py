"""The costmap: updates its layers and merges what they know of obstacles into one grid of costs."""

from __future__ import annotations

import itertools
import math
import threading
from collections import deque
from typing import Any, Collection, Deque, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import EMPTY, FREE_SPACE, INSCRIBED, NO_INFORMATION, CostGrid, Window, half_width_of
from mbf_relay.costmap.freshness import LEAST_ALLOWED, Freshness
from mbf_relay.costmap.layer import Layer, LayerContext, ZoneLimit, changed_window, missing_inputs, shifted, tracks_of
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.outline import check_padded, padded, radii
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.costmap.shared_inputs import inputs_of
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import OccupancyMap, too_large
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.parameters import ParameterSet
from mbf_relay.plugins import PluginFailure, failures_of

HISTORY = 64
"""Changes a snapshot's history holds."""

_revisions: Iterator[int] = itertools.count(1)


class Costmap:
    """A grid of costs that layers write into, as costmap_2d's LayeredCostmap. Methods may be called from any thread.

    Observations and maps wait in the layers until the next `update`; `snapshot` returns the grid as of the last one.

    Attributes:
        name: Its name in log lines and errors, e.g. "local_costmap".
        parameters: The values in force; only `reconfigure` changes them.
        layers: In the order in which they write.
        notes: One line for each of the user's values that was not used as it stands.
        inputs: The layers that take each sensor's observations; see `inputs_of`.
        failed: By name, why a layer that the user listed was left out.
    """

    def __init__(
        self, name: str, parameters: CostmapParameters, layers: Sequence[Layer], notes: Sequence[str] = (),
        failed: Optional[Mapping[str, str]] = None,
    ) -> None:
        self.name, self.parameters = name, parameters
        self.notes, self.failed = tuple(notes), dict(failed or {})
        self.layers: List[Layer] = list(layers)
        self._floor_layer = next((each for each in self.layers if each.maps_floor), None)
        self.inputs = inputs_of(self.layers)
        # the only lock: held for an update, for a copy of the snapshot, and while input is handed to the layers
        self._lock = threading.RLock()
        self._grid = parameters.grid()
        self._costs = np.zeros((0, 0), dtype=np.uint8)
        self._default = NO_INFORMATION if parameters.track_unknown_space else FREE_SPACE
        self._freshness = Freshness(name)
        self._sized_by_map, self._missing = False, ""
        self._due_grid: Optional[Grid] = None  # the next update takes it, see there
        self._redo_due = False  # the next update recomputes every cell
        self._copy: Optional[np.ndarray] = None  # of the costs, made when a snapshot is asked for
        self._shown: Optional[CostGrid] = None  # the last snapshot, until something changes
        self._history: Deque[Tuple[int, Window]] = deque(maxlen=HISTORY)
        self._near: Optional[Tuple[int, int]] = None  # see _near_costs
        for layer in self.layers:
            layer.attach(parameters.rolling_window, parameters.track_unknown_space)
        self._resize(self._grid)
        self.set_footprint(parameters.outline())

    @property
    def frame(self) -> str:
        """Frame of the costmap."""
        return self.parameters.global_frame

    @property
    def robot_frame(self) -> str:
        """Frame of the robot's base."""
        return self.parameters.robot_base_frame

    @property
    def sources(self) -> Dict[str, Any]:
        """All sensors by their names in `inputs`, with their parameters (SourceParameters)."""
        return {key: layer.sources[name] for key, [(layer, name), *_] in self.inputs.items()}

    @property
    def footprint(self) -> np.ndarray:
        """The padded outline in the base frame, shape (K, 2) in metres."""
        return self._footprint

    @property
    def updates(self) -> int:
        """Number of updates so far."""
        return self._freshness.updates

    @property
    def outline(self) -> np.ndarray:
        """The outline without padding in the base frame, shape (K, 2) in metres."""
        return self._outline

    def layer(self, name: str) -> Optional[Layer]:
        """Return the layer of that name, or None."""
        return next((layer for layer in self.layers if layer.name == name), None)

    def reconfigure(self, parameters: CostmapParameters) -> None:
        """Change parameters listed in RECONFIGURABLE, with effect from the next update on.

        Raises:
            ValueError: They change the grid of a costmap sized by its map, or the padding does not fit the footprint.
        """
        with self._lock:
            old = self.parameters
            resized = parameters.grid() != old.grid()
            if resized and self._sized_by_map:
                raise ValueError(
                    f"{self.name} has the size, origin and resolution of its map; width, height, resolution, origin_x "
                    "and origin_y cannot be changed")
            outline = parameters.outline()
            if np.array_equal(outline, old.outline()):
                outline = self._outline  # a topic may have changed it since
                check_padded(outline, parameters.footprint_padding, parameters.resolution)
            self.parameters = parameters
            self._due_grid = parameters.grid() if resized else self._due_grid
            self.set_footprint(outline)

    def reconfigure_layer(self, name: str, parameters: ParameterSet) -> None:
        """Change the parameters of the layer of that name, with effect from the next update on."""
        with self._lock:
            next(layer for layer in self.layers if layer.name == name).reconfigure(parameters)
            self._redo_due, self._near, self._shown = True, None, None

    def set_footprint(self, outline: np.ndarray) -> None:
        """Change the robot's outline: without padding, shape (K, 2) in metres, as `parse_footprint` returns it."""
        with self._lock:
            self._outline, self._near, self._shown = outline, None, None
            self._footprint = padded(outline, self.parameters.footprint_padding)
            self._inscribed_radius, self._circumscribed_radius = radii(self._footprint)
            for layer in self.layers:
                layer.set_footprint(self._inscribed_radius)

    def observe(self, source: str, observation: Observation, now: Optional[float] = None) -> None:
        """Pass an observation to the layers that take its source; the next update shows it.

        Args:
            source: One of `sources`.
            observation: In the costmap's frame.
            now: Present time (s), which also replaces a stamp of 0; None for the observation's stamp.

        Raises:
            ValueError: There is no such source.
        """
        takers = self.inputs.get(source)
        if not takers:
            raise ValueError(
                f"{self.name} has no observation source '{source}'; it has: {', '.join(self.sources) or 'none'}")
        observation = observation.dated(now).without_robot(self._outline)
        with self._lock:
            self._shown = None
            for layer, name in sorted(takers, key=lambda taker: taker[0].tracks is None):
                rest = layer.observe(name, observation, observation.stamp if now is None else now)
                observation = observation if rest is None or not layer.enabled else rest

    def refuse(self, source: str, reason: str, is_blind: bool = True) -> None:
        """Record why a message of a sensor, one of `sources`, was not used; see Layer.refuse."""
        with self._lock:
            for layer, name in self.inputs.get(source, ()):
                layer.refuse(name, reason, is_blind)

    @property
    def zone_limit(self) -> ZoneLimit:
        """The lowest speed limits that enabled layers set at the robot's place."""
        return ZoneLimit.lowest(layer.zone_limit for layer in self.layers if layer.enabled)

    @property
    def sees_all_round(self) -> bool:
        """Whether the sensors of one of its layers cover all directions; see Layer."""
        with self._lock:
            return any(layer.sees_all_round for layer in self.layers if layer.enabled)

    def is_sized_by(self, layer: str) -> bool:
        """Return whether that layer's map determines size, resolution and origin; see `set_map`."""
        return not self.parameters.rolling_window and self._floor_layer in self._takers_of_map(layer)

    def set_map(self, occupancy: OccupancyMap, layer: str = "") -> Optional[str]:
        """Pass a map to its layers. Without rolling_window, that of the first static layer also resizes the costmap.

        Args:
            occupancy: The map.
            layer: Name of the layer it is for; empty for all static layers (`maps_floor`).

        Returns:
            A warning for the user, or None.

        Raises:
            ValueError: The map's origin is rotated, and an upright grid that holds it would have too many cells.
        """
        grid = occupancy.upright_grid
        takers = self._takers_of_map(layer)
        is_first, sizes = self._floor_layer in takers, self.is_sized_by(layer)
        notice = None
        if is_first and abs(grid.resolution - self.parameters.resolution) > 1e-6:
            taken = "replaces the costmap's" if sizes else "is sampled at the costmap's"
            notice = (f"{self.name}: the map's resolution of {grid.resolution:.6g} m {taken} resolution of "
                      f"{self.parameters.resolution:.6g} m")
        trouble = too_large(grid.width, grid.height) if sizes else ""
        if trouble:
            raise ValueError(
                f"the map is turned by {occupancy.origin.theta:.6g} rad, and upright it takes {trouble}")
        with self._lock:
            if sizes:
                self._sized_by_map, self._due_grid = True, grid if grid != self._grid else None
            for taker in takers:
                taker.set_map(occupancy)
        return notice

    def update_map(self, x: int, y: int, data: np.ndarray, layer: str = "") -> None:
        """Pass an update of a part of the map, as of map_msgs/OccupancyGridUpdate, to its layers.

        Args:
            x, y: Column and row of its lower left cell in the map.
            data: int8 of shape (rows, columns).
            layer: As for `set_map`.

        Raises:
            ValueError: It does not lie within the map.
        """
        with self._lock:
            for taker in self._takers_of_map(layer):
                taker.update_map(x, y, data)

    def set_map_from_costmap(self, transform: Pose2D, layer: str = "") -> None:
        """Set the transform by which layers look up a map that lies in another frame.

        Args:
            transform: Takes poses in the costmap's frame to the map's.
            layer: As for `set_map`.
        """
        with self._lock:
            for taker in self._takers_of_map(layer):
                taker.set_map_from_costmap(transform)

    def _takers_of_map(self, layer: str) -> List[Layer]:
        """Return the layer of that name, if there is one; all static layers where it is empty."""
        return [each for each in self.layers if (each.name == layer if layer else each.maps_floor)]

    def update(self, now: float, robot_pose: Pose2D) -> None:
        """Update the layers and the costs of the cells they changed.

        Args:
            now: Time (s).
            robot_pose: Pose of the robot's base in the costmap's frame.

        Raises:
            ValueError: The pose is not finite.
            PluginFailure: A layer raised an exception; the next update recomputes every cell.
        """
        if not robot_pose.is_finite():
            raise ValueError(f"{self.name}: robot pose {tuple(robot_pose)} is not finite")
        with self._lock:
            if self._due_grid is not None:  # not sooner: a new grid is all free until its layers have written into it
                self._resize(self._due_grid)
                self._due_grid = None
            if self.parameters.rolling_window:
                self._follow(robot_pose)
            context = LayerContext(now, robot_pose, self._outline)
            active = [layer for layer in self.layers if layer.enabled]
            window = Window.of(self._grid) if self._redo_due else EMPTY
            self._redo_due = True  # stays so if a layer raises
            try:
                for layer in active:
                    with failures_of(layer, "layer"):
                        window = window.union(Window(*layer.update_bounds(context, window)))
                window = window.within(self._grid)
                if not window.is_empty:
                    self._redo(window, active)
            except PluginFailure as failure:
                self.note_failure(str(failure))
                raise
            self._shown, self._redo_due = None, False
            self._missing = missing_inputs(active)
            self._freshness.note(now)

    def note_failure(self, reason: str) -> None:
        """Record why it cannot be updated; until the next update, errors about a missing or old snapshot give it."""
        self._freshness.failure = reason

    def _redo(self, window: Window, layers: Sequence[Layer]) -> None:
        before = self._costs[window.slices].copy()
        self._costs[window.slices] = self._default
        try:
            for layer in layers:
                with failures_of(layer, "layer"):
                    layer.update_costs(self._costs, window)
        except PluginFailure:
            self._costs[window.slices] = before
            raise
        self._note_change(changed_window(before, self._costs, window))

    def _note_change(self, changed: Window) -> None:
        if not changed.is_empty:
            self._history.append((next(_revisions), changed))
            self._copy = self._shown = None

    def _follow(self, robot_pose: Pose2D) -> None:
        """Move a rolling window by whole cells so that the robot is in its middle, to within a cell."""
        grid = self._grid
        columns = int((robot_pose.x - grid.width * grid.resolution / 2.0 - grid.origin_x) / grid.resolution)
        rows = int((robot_pose.y - grid.height * grid.resolution / 2.0 - grid.origin_y) / grid.resolution)
        if columns == 0 and rows == 0:
            return
        self._grid = Grid(
            grid.resolution, grid.origin_x + columns * grid.resolution, grid.origin_y + rows * grid.resolution,
            grid.width, grid.height)
        self._costs = shifted(self._costs, columns, rows, self._default)
        for layer in self.layers:
            layer.shift(self._grid, columns, rows)
        self._history.clear()
        self._note_change(Window.of(self._grid))
        self._redo_due = True  # layers may hold windows in cells of the grid before the move

    def _resize(self, grid: Grid) -> None:
        self._grid = grid
        self._costs = np.full(grid.shape, self._default, dtype=np.uint8)
        for layer in self.layers:
            layer.resize(grid)
        self._history.clear()
        self._history.append((next(_revisions), Window.of(grid)))
        self._copy = self._shown = self._near = None

    def snapshot(self) -> CostGrid:
        """Return the costmap as of its last update; later updates do not change the result."""
        with self._lock:
            if self._copy is None:
                self._copy = self._costs.copy()
            if self._shown is None:
                tracks = tracks_of(self.layers)
                self._shown = CostGrid(
                    self._grid, self._copy, self.frame, self._footprint, self._inscribed_radius,
                    self._circumscribed_radius, self._history[-1][0], self._freshness.updated or 0.0,
                    tuple(self._history), self.parameters.obstacle_overlap, tracks, *self._near_costs(),
                    sees_all_round=not tracks or self.sees_all_round)
            return self._shown

    def _near_costs(self) -> Tuple[int, int]:
        """Return `side_cost` and `turning_cost` of CostGrid."""
        if self._near is None:
            half_width = half_width_of(self._footprint, self._inscribed_radius)
            margin = (0.5 - self.parameters.obstacle_overlap) * self._grid.resolution  # an obstacle fills its cell
            told = []
            for distance in (half_width, self._circumscribed_radius):
                costs = [layer.cost_at(distance + margin) for layer in self.layers if layer.enabled]
                told.append(max((cost for cost in costs if cost is not None), default=INSCRIBED))
            self._near = told[0], told[1]
        return self._near

    def oriented_footprint(self, pose: Pose2D) -> np.ndarray:
        """Return the padded outline at a pose, shape (K, 2) in metres."""
        return pose.transform_points(self._footprint)

    def clear(
        self, layers: Optional[Collection[str]] = None, around: Optional[Pose2D] = None, side: float = math.inf,
        inside: bool = True,
    ) -> None:
        """Clear observed obstacles; the next update shows that, and marks the newest observations again.

        Args:
            layers: Names of the layers to clear; None for all. Maps, masks and prohibited areas stay.
            around: Centre of a square, in the costmap's frame; None for the whole costmap.
            side: Length (m) of the square's sides.
            inside: Clear inside the square; False for outside.
        """
        with self._lock:
            window = Window.of(self._grid)
            if around is not None and math.isfinite(side):
                window = Window.around(self._grid, around.x, around.y, side / 2.0)
            for layer in self.layers:
                if layers is None or layer.name in layers:
                    layer.clear(window, inside)

    def stale_reason(self, now: float) -> Optional[str]:
        """Return why it is too old or incomplete for driving at time `now` (s), or None."""
        with self._lock:
            resting = LEAST_ALLOWED if self.sources else math.inf  # at update_frequency 0, sensors do not show either
            trouble = self._freshness.trouble(now, self.parameters.update_frequency, resting)
            reasons = (layer.stale_reason(now) for layer in self.layers if layer.enabled)
            return trouble or next((f"{self.name}: {reason}" for reason in reasons if reason is not None), None)

    def planning_trouble(self, now: float) -> Optional[PlanningError]:
        """Return why it is too old or lacks a map for planning at time `now` (s), or None. Sensors may be silent."""
        with self._lock:
            if self._freshness.updated is None:
                return PlanningError(PlanOutcome.NOT_INITIALIZED, self._freshness.never(missing_inputs(self.layers)))
            if self._missing:  # as of the last update: the snapshot does not show a map that came after it
                return PlanningError(PlanOutcome.MAP_ERROR, f"{self.name}: {self._missing}")
            trouble = self._freshness.trouble(now, self.parameters.update_frequency, math.inf)
            return PlanningError(PlanOutcome.MAP_ERROR, trouble) if trouble is not None else None
