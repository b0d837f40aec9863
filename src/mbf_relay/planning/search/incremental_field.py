"""Incremental fields of costs to go to one goal: grown as far as a plan needs, and kept for the next plan."""

from __future__ import annotations

import abc
import math
from typing import Any, ClassVar, Optional, Tuple

import numpy as np

from mbf_relay.maps import LARGEST_SIDE
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import cost_to_go_kernels, descent_kernels, fast_marching_kernels, queue_kernels

Cell = Tuple[int, int]
"""Column and row."""

WORTH_UPDATING = 0.1
"""Share of the expanded cells that may have changed for an update; with more, growing a new field is faster: four times
where all have changed. 0 for an update only where nothing has."""

STORE_PER_CELL = 4
"""Entries waiting per expanded cell above which growing a new field is faster."""

_HEURISTIC_SHARE = np.float32(0.99999)  # slightly below 1, so that rounding never makes the heuristic too high
_FIRST_BUCKET = 512
_FIRST_STORE = 1 << 12


class IncrementalField(abc.ABC):
    """Costs to go from the cells of a grid to one goal, exact for every cell a plan needs.

    For the same goal, the next call first updates the field where costs changed, unless too many did (WORTH_UPDATING),
    and then grows it only if it does not reach the start yet. Its values are those of a field grown from scratch, up to
    rounding.

    Attributes:
        expanded: Cells expanded in the last call, for benchmarks.
        invalidated: Cells reset because of changes in the last call; None where the field was grown from scratch.
        table: Shape (256,): the last call's weights as the kernels use them, see `table_of`.
    """

    kernels: ClassVar[Any]
    """The module whose `grow` and `invalidate` make the field."""

    bucket: ClassVar[np.float32]
    """Width of the queue's buckets, in steps over the cheapest cell."""

    def __init__(self) -> None:
        self.expanded = 0
        self.invalidated: Optional[int] = None
        self._goal: Optional[Cell] = None
        self.table = np.zeros(256, dtype=np.float32)
        self._revision = 0
        self._grown = 0  # cells expanded once, without what updates expanded again
        self._slope = np.float32(0.0)
        self._weights = b""  # as bytes: ten times faster to compare
        self._highest = np.float32(0.0)  # of the weights
        self._free = np.zeros(256, dtype=np.bool_)  # costs whose weight is above 0
        self._cheapest = 0  # the cost of the lowest weight
        self._lowest_from = self.table  # the lowest weight of each cost and those above it
        self._field = np.zeros((0, 0), dtype=np.float32)
        self._seen = np.zeros((0, 0), dtype=np.uint8)  # the costs the field was grown from, in `_looked_at`
        self._sizes = np.zeros(queue_kernels.BUCKETS, dtype=np.int64)
        self._cells = np.zeros((queue_kernels.BUCKETS, _FIRST_BUCKET), dtype=np.int32)
        self._keys = np.zeros((queue_kernels.BUCKETS, _FIRST_BUCKET), dtype=np.float32)
        self._apart_cells = np.zeros(_FIRST_STORE, dtype=np.int32)
        self._apart_keys = np.zeros(_FIRST_STORE, dtype=np.float32)
        self._state = np.zeros(queue_kernels.STATE_SIZE, dtype=np.int64)

    @staticmethod
    @abc.abstractmethod
    def table_of(weights: np.ndarray) -> np.ndarray:
        """Return the table of costs that the kernels use, made from the weights: shape (256,), float32."""

    def reach(
        self, costs: np.ndarray, weights: np.ndarray, start: Cell, goal: Cell, cancelled: Cancellation,
        revision: int = 0, all_around: bool = False,
    ) -> bool:
        """Grow the field from a goal until the start's value is final; return False where no free cells connect them.

        Args:
            costs: Shape (height, width), uint8, C-contiguous.
            weights: Shape (256,), float32: path cost per cell of length for each cost; 0 where it must not be entered.
            start, goal: Cells, (column, row), whose weight is above 0.
            cancelled: Stops the search when set.
            revision: The costmap's: costs of equal revisions are not compared; 0 for none.
            all_around: Search without the heuristic (Dijkstra), so that the field is known in all directions.

        Raises:
            PlanningError: CANCELED, or MAP_ERROR where the map is too large.
        """
        may_keep, before = self._may_keep(costs, weights, goal), 0
        # a change seldom alters the start's value much: growing to the old value at once saves many steps
        expected = self._field[start[1], start[0]] if may_keep else np.float32(0.0)
        if may_keep and self._update(costs, revision):
            before = int(self._state[queue_kernels.EXPANDED])
        else:
            self._begin(costs, weights, goal)
        if before == 0 or revision == 0 or revision != self._revision:
            self._slope = self._lowest_weight(costs) * _HEURISTIC_SHARE
        verdict = self._grow(costs, start, cancelled, np.float32(0.0) if all_around else self._slope, expected)
        self.expanded = int(self._state[queue_kernels.EXPANDED]) - before
        if not self.invalidated:
            self._grown += self.expanded
        if self.expanded or self._revision != revision or revision == 0:
            self._remember(costs)
        self._revision = revision
        if verdict == queue_kernels.CANCELLED:
            raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
        return bool(self._field[start[1], start[0]] > 0.0)

    def field(self) -> np.ndarray:
        """Return the field, shape (height, width), float32; 0 where unknown. The next call of `reach` overwrites it."""
        return self._field

    def _may_keep(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> bool:
        return goal == self._goal and costs.shape == self._field.shape and weights.tobytes() == self._weights

    def _begin(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> None:
        """Reset the field to the goal's cell alone."""
        height, width = costs.shape
        if max(height, width) > LARGEST_SIDE:
            raise PlanningError(
                PlanOutcome.MAP_ERROR,
                f"the costmap has {width} x {height} cells; planners take at most {LARGEST_SIDE} each way")
        self.invalidated, self._grown = None, 0
        if self._field.shape != costs.shape:
            self._field = np.zeros(costs.shape, dtype=np.float32)
            self._seen = np.zeros(costs.shape, dtype=np.uint8)
        else:
            self._field[self._looked_at()] = 0.0
            if self._goal is not None:
                self._field[self._goal[1], self._goal[0]] = 0.0
        self._goal = goal
        if weights.tobytes() != self._weights:
            self._take_weights(weights)
        self._sizes.fill(0)
        state = self._state
        state.fill(0)
        state[queue_kernels.MIN_COLUMN], state[queue_kernels.MIN_ROW] = width, height
        state[queue_kernels.MAX_COLUMN] = state[queue_kernels.MAX_ROW] = -1
        self._field[goal[1], goal[0]] = queue_kernels.ROOT_VALUE
        self._apart_cells[0], self._apart_keys[0] = goal[1] * 65536 + goal[0], queue_kernels.ROOT_VALUE
        state[queue_kernels.APART] = 1

    def _take_weights(self, weights: np.ndarray) -> None:
        """Keep the weights, and what every plan derives from them."""
        self._weights = weights.tobytes()
        self._highest = weights.max()
        self.table = self.table_of(weights)
        self._free = weights > 0.0
        counted = np.where(self._free, weights, np.float32(np.inf))
        self._cheapest = int(np.argmin(counted))
        self._lowest_from = np.minimum.accumulate(counted[::-1])[::-1].copy()

    def _looked_at(self) -> Tuple[slice, slice]:
        """Return slices (rows, columns) of a box that holds the expanded cells and their neighbours."""
        state = self._state
        return (
            slice(max(int(state[queue_kernels.MIN_ROW]) - 1, 0), int(state[queue_kernels.MAX_ROW]) + 2),
            slice(max(int(state[queue_kernels.MIN_COLUMN]) - 1, 0), int(state[queue_kernels.MAX_COLUMN]) + 2),
        )

    def _remember(self, costs: np.ndarray) -> None:
        part = self._looked_at()
        self._seen[part] = costs[part]

    def _update(self, costs: np.ndarray, revision: int) -> bool:
        """Update the field after changes of the map; return False where growing a new one is better."""
        if revision != 0 and revision == self._revision:
            self._set_apart()
            self.invalidated = 0
            return True
        changed = self._changed(costs)
        if changed is None:
            return False
        waiting = self._set_apart()
        self.invalidated = 0
        if len(changed) == 0:
            return True
        if waiting > STORE_PER_CELL * self._grown + _FIRST_STORE:
            return False  # after many updates the same cells wait several times
        unsupported = np.empty(self._seen[self._looked_at()].size + 9 * len(changed), dtype=np.int32)
        forgotten = int(self.kernels.invalidate(costs, self.table, self._field, changed, unsupported))
        if forgotten < 0:
            return False
        self._reserve(waiting + 9 * (forgotten + len(changed)))
        queue_kernels.requeue(
            self._field, changed, unsupported, forgotten, self._apart_cells, self._apart_keys, self._state)
        self.invalidated = forgotten
        return True

    def _changed(self, costs: np.ndarray) -> Optional[np.ndarray]:
        """Return the cells, (N, 2), whose costs changed since the field was grown; None for too many."""
        rows, columns = self._looked_at()
        height, width = costs.shape
        most = int(WORTH_UPDATING * self._grown)
        changed = np.empty((most, 2), dtype=np.int32)
        found = queue_kernels.changed_cells(
            costs, self._seen, columns.start, rows.start, min(columns.stop, width), min(rows.stop, height), changed)
        return None if found < 0 else changed[:found]

    def _set_apart(self) -> int:
        """Empty the queue's ring into its store; return how many entries wait there."""
        while True:
            waiting = queue_kernels.set_apart(
                self._field, self._sizes, self._cells, self._keys, self._apart_cells, self._apart_keys, self._state)
            if waiting >= 0:
                return int(waiting)
            self._reserve(-waiting)

    def _reserve(self, entries: int) -> None:
        """Enlarge the store where it has room for fewer entries than `entries`."""
        if len(self._apart_cells) < entries:
            self._apart_cells = np.resize(self._apart_cells, 2 * entries)
            self._apart_keys = np.resize(self._apart_keys, 2 * entries)

    @abc.abstractmethod
    def _grow(
        self, costs: np.ndarray, start: Cell, cancelled: Cancellation, slope: np.float32, expected: np.float32
    ) -> int:
        """Grow the field until the start's value is final; return REACHED, EXHAUSTED or CANCELLED of queue_kernels.

        Args:
            costs, start, cancelled: As for `reach`.
            slope: The heuristic's cost per cell.
            expected: The start's value before the last change of the map; 0 for not known.
        """

    def _cells_and_queue(self, costs: np.ndarray) -> Tuple[Any, ...]:
        """Return costs, table, field and queue as the first arguments of the kernels `grow`."""
        height, width = costs.shape
        return (
            costs.reshape(-1), width, height, self.table, self._field.reshape(-1), self._sizes, self._cells, self._keys,
            self._apart_cells, self._apart_keys, self._state)

    def _lowest_weight(self, costs: np.ndarray) -> np.float32:
        """Return a lower bound of the weights of cells connected with the goal, for the heuristic."""
        assert self._goal is not None
        lowest = queue_kernels.lowest_connected(costs, self._free, self._goal[0], self._goal[1], self._cheapest)
        return np.float32(self._lowest_from[lowest])

    def _enlarge(self) -> None:
        self._cells = np.concatenate((self._cells, np.zeros_like(self._cells)), axis=1)
        self._keys = np.concatenate((self._keys, np.zeros_like(self._keys)), axis=1)


class CostToGo(IncrementalField):
    """Exact costs to go over 8-connected steps.

    A step costs the mean of the two cells' weights times its length (cells); a diagonal step is only allowed where both
    orthogonal neighbours may be entered.
    """

    kernels: ClassVar[Any] = cost_to_go_kernels
    bucket: ClassVar[np.float32] = np.float32(1.0)  # no step is shorter, so what is taken from one bucket is final

    @staticmethod
    def table_of(weights: np.ndarray) -> np.ndarray:
        """Return half of each weight, inf where the cell may not be entered."""
        return np.where(weights > 0.0, weights * np.float32(0.5), np.float32(np.inf)).astype(np.float32)

    def _grow(
        self, costs: np.ndarray, start: Cell, cancelled: Cancellation, slope: np.float32, expected: np.float32
    ) -> int:
        # buckets so wide that no expansion raises the key by more than the ring's length
        widest = np.float32(1.5) * (self._highest + slope) / np.float32(queue_kernels.BUCKETS - 3)
        aim = (start[0], start[1], slope, np.float32(1.0) / max(slope * self.bucket, widest))
        verdict = queue_kernels.SPREAD_DUE
        while True:
            cells = self._cells_and_queue(costs)
            if verdict == queue_kernels.SPREAD_DUE and not queue_kernels.spread(*cells[5:], *aim):
                self._enlarge()
                continue
            verdict = cost_to_go_kernels.grow(*cells[:8], self._state, *aim, cancelled.flag)
            if verdict == queue_kernels.BUCKET_FULL:
                self._enlarge()
            elif verdict != queue_kernels.SPREAD_DUE:
                return verdict

    def path(self, costs: np.ndarray, start: Cell) -> np.ndarray:
        """Return the cells of the cheapest path from a start that the field reaches: (N, 2) int32, the goal's last."""
        size = 4 * max(costs.shape) + 16
        while True:
            path = np.empty((size, 2), dtype=np.int32)
            count = cost_to_go_kernels.follow(costs, self.table, self._field, start[0], start[1], path)
            if count >= 0:
                return path[:count]
            size *= 4


class FastMarchingPotential(IncrementalField):
    """The fast-marching potential: arrival time of a front from the goal by the eikonal equation, for smooth paths."""

    kernels: ClassVar[Any] = fast_marching_kernels
    bucket: ClassVar[np.float32] = np.float32(0.7)  # a front rises by less than a step from cell to cell

    @staticmethod
    def table_of(weights: np.ndarray) -> np.ndarray:
        """Return the weights, inf where the cell may not be entered."""
        return np.where(weights > 0.0, weights, np.float32(np.inf)).astype(np.float32)

    def _grow(
        self, costs: np.ndarray, start: Cell, cancelled: Cancellation, slope: np.float32, expected: np.float32
    ) -> int:
        widest = np.float32(1.5) * self._highest / np.float32(queue_kernels.BUCKETS - 3)
        inverse_width = np.float32(1.0) / max(self._slope * self.bucket, widest)
        aim = (start[0], start[1], slope, inverse_width)
        assert self._goal is not None
        straight = math.hypot(start[0] - self._goal[0], start[1] - self._goal[1])
        progress = np.zeros(3)
        while True:
            verdict: int = fast_marching_kernels.grow(
                *self._cells_and_queue(costs), *aim, straight, expected, progress, cancelled.flag)
            if verdict == queue_kernels.BUCKET_FULL:
                self._enlarge()
            elif verdict == queue_kernels.STORE_FULL:
                self._reserve(len(self._apart_cells) + 1)
            else:
                return verdict

    def path(self, start: Tuple[float, float]) -> np.ndarray:
        """Return points down the potential to the goal's cell or one next to it: (N, 2), in cells.

        Args:
            start: The first point, in cells (centres at halves), in a cell that the field reaches.
        """
        assert self._goal is not None
        size = 16 * max(self._field.shape) + 16
        while True:
            path = np.empty((size, 2))
            count = descent_kernels.descend(self._field, start[0], start[1], self._goal[0], self._goal[1], path)
            if count >= 0:
                return path[:count]
            size *= 4

    def cost_at(self, x: float, y: float) -> float:
        """Return the cost of the path from a point, in cells: its potential less the goal's."""
        value = descent_kernels.potential_at(self._field, x, y)
        if not np.isfinite(value):
            value = self._field[int(y), int(x)]
        return float(value) - queue_kernels.ROOT_VALUE
