"""Incremental distance fields: costs to go to one goal, grown as far as a plan needs, kept for the next one."""

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
"""Share of the cells looked at whose change is worked in; where more changed, a new field is quicker."""

STORE_PER_CELL = 4
"""Entries waiting for each cell looked at beyond which a new field is quicker."""

_HEURISTIC_SHARE = np.float32(0.99999)  # a hair less than the truth, so that rounding never makes it more
_FIRST_BUCKET = 512
_FIRST_STORE = 1 << 12


class IncrementalField(abc.ABC):
    """A field over the cells of a grid that falls toward one goal, exact for every cell a plan needed.

    Called again for the same goal, it is read where it reaches the start, grown on where not, and updated first where
    costs changed; its values are those of one grown from scratch.

    Attributes:
        expanded: Cells looked at in the last call, for benchmarks.
        invalidated: Cells that lost their value to changes in the last call, None where the field was begun anew.
        table: What the kernels look the last call's costs up in, see `table_of`.
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
        self._slope = np.float32(0.0)
        self._weights = b""  # as bytes, which are compared in a tenth of the time
        self._highest = np.float32(0.0)  # of the weights
        self._free = np.zeros(256, dtype=np.bool_)  # costs whose weight is above 0
        self._cheapest = 0  # the cost of the lowest weight
        self._lowest_from = self.table  # the lowest weight of each cost and those above it
        self._field = np.zeros((0, 0), dtype=np.float32)
        self._seen = np.zeros((0, 0), dtype=np.uint8)  # the costs the field was made from, where it looked
        self._sizes = np.zeros(queue_kernels.BUCKETS, dtype=np.int64)
        self._cells = np.zeros((queue_kernels.BUCKETS, _FIRST_BUCKET), dtype=np.int32)
        self._keys = np.zeros((queue_kernels.BUCKETS, _FIRST_BUCKET), dtype=np.float32)
        self._apart_cells = np.zeros(_FIRST_STORE, dtype=np.int32)
        self._apart_keys = np.zeros(_FIRST_STORE, dtype=np.float32)
        self._state = np.zeros(queue_kernels.STATE_SIZE, dtype=np.int64)

    @staticmethod
    @abc.abstractmethod
    def table_of(weights: np.ndarray) -> np.ndarray:
        """Return what the kernels look costs up in, from the weights: shape (256,), float32."""

    def reach(
        self, costs: np.ndarray, weights: np.ndarray, start: Cell, goal: Cell, cancelled: Cancellation,
        revision: int = 0, all_around: bool = False,
    ) -> bool:
        """Have the field reach from a goal to a start; False where no free cells connect them.

        Args:
            costs: Shape (height, width), uint8, C-contiguous.
            weights: Shape (256,), float32: what crossing a cell of each cost counts; 0 where it may not be entered.
            start, goal: Cells of the grid whose weight is above 0.
            cancelled: Stops the search when set.
            revision: Of the costmap: equal ones stand for equal costs, which need no look; 0 for none.
            all_around: Look at every cell nearer to the goal than the start instead of mainly toward the start.

        Raises:
            PlanningError: CANCELED, or MAP_ERROR where the map is too large.
        """
        may_keep, before = self._may_keep(costs, weights, goal), 0
        # what the start's value was, a change seldom leaves far behind: to grow up to there at once saves many steps
        expected = self._field[start[1], start[0]] if may_keep else np.float32(0.0)
        if may_keep and self._update(costs, revision):
            before = int(self._state[queue_kernels.EXPANDED])
        else:
            self._begin(costs, weights, goal)
        if before == 0 or revision == 0 or revision != self._revision:
            self._slope = self._lowest_weight(costs) * _HEURISTIC_SHARE
        verdict = self._grow(costs, start, cancelled, np.float32(0.0) if all_around else self._slope, expected)
        self.expanded = int(self._state[queue_kernels.EXPANDED]) - before
        if self.expanded or self._revision != revision or revision == 0:
            self._remember(costs)
        self._revision = revision
        if verdict == queue_kernels.CANCELLED:
            raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
        return bool(self._field[start[1], start[0]] > 0.0)

    def field(self) -> np.ndarray:
        """Return the field, shape (height, width), float32; 0 where nothing is known. Not to be kept."""
        return self._field

    def _may_keep(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> bool:
        return goal == self._goal and costs.shape == self._field.shape and weights.tobytes() == self._weights

    def _begin(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> None:
        """Start a field that holds the goal alone."""
        height, width = costs.shape
        if max(height, width) > LARGEST_SIDE:
            raise PlanningError(
                PlanOutcome.MAP_ERROR,
                f"the costmap has {width} x {height} cells; planners take at most {LARGEST_SIDE} each way")
        self.invalidated = None
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
        """Keep weights and what is looked up of them in every plan."""
        self._weights = weights.tobytes()
        self._highest = weights.max()
        self.table = self.table_of(weights)
        self._free = weights > 0.0
        counted = np.where(self._free, weights, np.float32(np.inf))
        self._cheapest = int(np.argmin(counted))
        self._lowest_from = np.minimum.accumulate(counted[::-1])[::-1].copy()

    def _looked_at(self) -> Tuple[slice, slice]:
        """Return the part of the map the field rests on: the cells expanded and those next to them."""
        state = self._state
        return (
            slice(max(int(state[queue_kernels.MIN_ROW]) - 1, 0), int(state[queue_kernels.MAX_ROW]) + 2),
            slice(max(int(state[queue_kernels.MIN_COLUMN]) - 1, 0), int(state[queue_kernels.MAX_COLUMN]) + 2),
        )

    def _remember(self, costs: np.ndarray) -> None:
        part = self._looked_at()
        self._seen[part] = costs[part]

    def _update(self, costs: np.ndarray, revision: int) -> bool:
        """Bring the field in order after changes of the map; False where it is better begun anew."""
        if revision != 0 and revision == self._revision:
            self._set_apart()
            self.invalidated = 0
            return True
        waiting = self._set_apart()
        self.invalidated = 0
        changed = self._changed(costs)
        if changed is None:
            return False
        if len(changed) == 0:
            return True
        if waiting > STORE_PER_CELL * int(self._state[queue_kernels.EXPANDED]) + _FIRST_STORE:
            return False  # many updates have left the same cells waiting many times over
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
        """Return columns and rows of the cells that changed since the field looked, (N, 2); None for too many."""
        rows, columns = self._looked_at()
        height, width = costs.shape
        most = int(WORTH_UPDATING * max(int(self._state[queue_kernels.EXPANDED]), 1))
        changed = np.empty((most, 2), dtype=np.int32)
        found = queue_kernels.changed_cells(
            costs, self._seen, columns.start, rows.start, min(columns.stop, width), min(rows.stop, height), changed)
        return None if found < 0 else changed[:found]

    def _set_apart(self) -> int:
        """Empty the queue's ring into its store; returns how many entries wait there."""
        while True:
            waiting = queue_kernels.set_apart(
                self._field, self._sizes, self._cells, self._keys, self._apart_cells, self._apart_keys, self._state)
            if waiting >= 0:
                return int(waiting)
            self._reserve(-waiting)

    def _reserve(self, entries: int) -> None:
        """Make the store long enough for so many entries in all."""
        if len(self._apart_cells) < entries:
            self._apart_cells = np.resize(self._apart_cells, 2 * entries)
            self._apart_keys = np.resize(self._apart_keys, 2 * entries)

    @abc.abstractmethod
    def _grow(
        self, costs: np.ndarray, start: Cell, cancelled: Cancellation, slope: np.float32, expected: np.float32
    ) -> int:
        """Grow the field until the start's value is final; returns a verdict that asks for no more memory.

        Args:
            costs: As for `reach`.
            start: Likewise.
            cancelled: Likewise.
            slope: What the heuristic counts for one cell.
            expected: What the start's value was before the last change; 0 for not known.
        """

    def _cells_and_queue(self, costs: np.ndarray) -> Tuple[Any, ...]:
        """Return costs, table, field and queue as the kernels that grow take them."""
        height, width = costs.shape
        return (
            costs.reshape(-1), width, height, self.table, self._field.reshape(-1), self._sizes, self._cells, self._keys,
            self._apart_cells, self._apart_keys, self._state)

    def _lowest_weight(self, costs: np.ndarray) -> np.float32:
        """Return a weight no cell connected with the goal goes below: the higher, the steeper the heuristic."""
        assert self._goal is not None
        lowest = queue_kernels.lowest_connected(costs, self._free, self._goal[0], self._goal[1], self._cheapest)
        return np.float32(self._lowest_from[lowest])

    def _enlarge(self) -> None:
        self._cells = np.concatenate((self._cells, np.zeros_like(self._cells)), axis=1)
        self._keys = np.concatenate((self._keys, np.zeros_like(self._keys)), axis=1)


class CostToGo(IncrementalField):
    """Costs to go over 8-connected steps: exact, and so are the paths.

    A step between two cells costs the mean of what the cells count, times its length; a diagonal step needs both
    orthogonal neighbours free.
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
        # one expansion raises the key by no more than the ring is long
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
        """Return the cells of the cheapest way from a start the field reaches: (N, 2) int32, the goal's cell last."""
        size = 4 * max(costs.shape) + 16
        while True:
            path = np.empty((size, 2), dtype=np.int32)
            count = cost_to_go_kernels.follow(costs, self.table, self._field, start[0], start[1], path)
            if count >= 0:
                return path[:count]
            size *= 4


class FastMarchingPotential(IncrementalField):
    """The fast-marching potential: travel time of a front from the goal by the eikonal equation, for smooth paths."""

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
        """Return points down the potential to the goal's cell or the one next to it: (N, 2), in cells.

        Args:
            start: In cells, the centre of a cell at halves; in a cell the field reaches. The first point.
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
        """Return the potential at a point, in cells, above the goal's: what the way down from there counts."""
        value = descent_kernels.potential_at(self._field, x, y)
        if not np.isfinite(value):
            value = self._field[int(y), int(x)]
        return float(value) - queue_kernels.ROOT_VALUE
