"""The cost-to-go field of one goal: grown as far as a plan needs it, kept and repaired for the next one."""

from __future__ import annotations

from typing import Optional, Tuple

import numpy as np

from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import field_kernels as kernels
from mbf_relay.planning.planner import Cancellation

Cell = Tuple[int, int]
"""Column and row."""

LARGEST_SIDE = 32767
"""Cells: rows and columns share one 32-bit number in the queue."""

WORTH_REPAIRING = 0.1
"""Share of the cells looked at whose change is repaired; where more changed, a new field is quicker."""

_HEURISTIC_SHARE = np.float32(0.99999)  # a hair less than the truth, so that rounding never makes it more
_FIRST_BUCKET = 512
_FIRST_STORE = 1 << 12


class CostToGo:
    """Costs from cells of a grid to a goal over 8-connected steps, exact for every cell a plan needed.

    A step between two cells costs the mean of what the cells count, times its length; a diagonal step needs both
    orthogonal neighbours free. Called again for the same goal, it reads the new path off the field where that reaches
    it, grows it on where not, and repairs it first where costs changed; the cost is that of a search from scratch.

    Attributes:
        expanded: Cells looked at in the last call, for benchmarks.
        repaired: Cells that lost their value in the last call's repair, None where the field was begun anew.
    """

    def __init__(self) -> None:
        self.expanded = 0
        self.repaired: Optional[int] = None
        self._goal: Optional[Cell] = None
        self._halves = np.zeros(256, dtype=np.float32)
        self._weights = np.zeros(256, dtype=np.float32)
        self._field = np.zeros((0, 0), dtype=np.float32)
        self._seen = np.zeros((0, 0), dtype=np.uint8)  # the costs the field was made from, where it looked
        self._sizes = np.zeros(kernels.BUCKETS, dtype=np.int64)
        self._cells = np.zeros((kernels.BUCKETS, _FIRST_BUCKET), dtype=np.int32)
        self._keys = np.zeros((kernels.BUCKETS, _FIRST_BUCKET), dtype=np.float32)
        self._apart_cells = np.zeros(_FIRST_STORE, dtype=np.int32)
        self._apart_keys = np.zeros(_FIRST_STORE, dtype=np.float32)
        self._state = np.zeros(kernels.STATE_SIZE, dtype=np.int64)

    def plan(
        self, costs: np.ndarray, weights: np.ndarray, start: Cell, goal: Cell, cancelled: Cancellation
    ) -> Optional[Tuple[np.ndarray, float]]:
        """Return the cheapest way between two free cells, or None where there is none.

        Args:
            costs: Shape (height, width), uint8, C-contiguous.
            weights: Shape (256,), float32: what a straight step over a cell of each cost counts; 0 where it may not be
                entered.
            start, goal: Cells of the grid whose weight is above 0.
            cancelled: Stops the search when set.

        Returns:
            Cells from start to goal, shape (N, 2) int32, and the cost.

        Raises:
            PlanningError: CANCELED, or MAP_ERROR where the map is too large.
        """
        before = 0
        if self._may_keep(costs, weights, goal) and self._repair(costs):
            before = int(self._state[kernels.EXPANDED])
        else:
            self._begin(costs, weights, goal)
        verdict = self._grow(costs, start, cancelled)
        self.expanded = int(self._state[kernels.EXPANDED]) - before
        self._remember(costs)
        if verdict == kernels.CANCELLED:
            raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
        if verdict == kernels.EXHAUSTED and self._field[start[1], start[0]] == 0.0:
            return None
        path = self._follow(costs, start)
        return path, path_cost(costs, weights, path)

    def field(self) -> np.ndarray:
        """Return the costs to go, shape (height, width), float32; 0 where none is known. Not to be kept."""
        return self._field

    def _may_keep(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> bool:
        return goal == self._goal and costs.shape == self._field.shape and np.array_equal(weights, self._weights)

    def _begin(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> None:
        """Start a field that holds the goal alone."""
        height, width = costs.shape
        if max(height, width) > LARGEST_SIDE:
            raise PlanningError(
                PlanOutcome.MAP_ERROR,
                f"the costmap has {width} x {height} cells; planners take at most {LARGEST_SIDE} each way")
        self.repaired = None
        if self._field.shape != costs.shape:
            self._field = np.zeros(costs.shape, dtype=np.float32)
            self._seen = np.zeros(costs.shape, dtype=np.uint8)
        else:
            self._field[self._looked_at()] = 0.0
            if self._goal is not None:
                self._field[self._goal[1], self._goal[0]] = 0.0
        self._goal = goal
        self._weights = weights.copy()
        self._halves = np.where(weights > 0.0, weights * np.float32(0.5), np.float32(np.inf)).astype(np.float32)
        self._sizes.fill(0)
        state = self._state
        state.fill(0)
        state[kernels.MIN_COLUMN], state[kernels.MIN_ROW] = width, height
        state[kernels.MAX_COLUMN] = state[kernels.MAX_ROW] = -1
        self._field[goal[1], goal[0]] = kernels.ROOT_VALUE
        self._apart_cells[0], self._apart_keys[0] = goal[1] * 65536 + goal[0], kernels.ROOT_VALUE
        state[kernels.APART] = 1

    def _looked_at(self) -> Tuple[slice, slice]:
        """Return the part of the map the field rests on: the cells expanded and those next to them."""
        state = self._state
        return (
            slice(max(int(state[kernels.MIN_ROW]) - 1, 0), int(state[kernels.MAX_ROW]) + 2),
            slice(max(int(state[kernels.MIN_COLUMN]) - 1, 0), int(state[kernels.MAX_COLUMN]) + 2),
        )

    def _remember(self, costs: np.ndarray) -> None:
        part = self._looked_at()
        self._seen[part] = costs[part]

    def _repair(self, costs: np.ndarray) -> bool:
        """Bring the field in order after changes of the map; False where it is better begun anew."""
        part = self._looked_at()
        differs = costs[part] != self._seen[part]
        waiting = self._set_apart()
        self.repaired = 0
        if not differs.any():
            return True
        rows, columns = np.nonzero(differs)
        if len(rows) > WORTH_REPAIRING * max(int(self._state[kernels.EXPANDED]), 1):
            return False
        changed = np.column_stack((columns + part[1].start, rows + part[0].start)).astype(np.int32)
        looked_at = self._seen[part].size
        self._reserve(waiting + 9 * (looked_at + len(changed)))
        forgotten = kernels.repair(
            costs, self._halves, self._field, changed, np.empty(looked_at + 9 * len(changed), dtype=np.int32),
            self._apart_cells, self._apart_keys, self._state)
        self.repaired = int(forgotten)
        return forgotten >= 0

    def _set_apart(self) -> int:
        """Empty the queue's ring into its store; returns how many entries wait there."""
        while True:
            waiting = kernels.set_apart(
                self._field, self._sizes, self._cells, self._keys, self._apart_cells, self._apart_keys, self._state)
            if waiting >= 0:
                return int(waiting)
            self._reserve(-waiting)

    def _reserve(self, entries: int) -> None:
        if len(self._apart_cells) < entries:
            self._apart_cells = np.resize(self._apart_cells, entries)
            self._apart_keys = np.resize(self._apart_keys, entries)

    def _grow(self, costs: np.ndarray, start: Cell, cancelled: Cancellation) -> int:
        height, width = costs.shape
        weights = self._weights
        # nothing on the map counts less than its lowest cost does, which makes for a steep heuristic
        cheapest = weights[weights > 0.0].min()
        lowest = kernels.lowest_cost(costs, start[1], int(np.argmin(np.where(weights > 0.0, weights, np.inf))))
        reachable = weights[lowest:][weights[lowest:] > 0.0]
        slope = (reachable.min() if len(reachable) else cheapest) * _HEURISTIC_SHARE
        # one expansion raises the key by no more than the ring is long
        widest = np.float32(1.5) * (weights.max() + slope) / np.float32(kernels.BUCKETS - 3)
        inverse_width = np.float32(1.0) / max(slope, widest)
        aim = (start[0], start[1], slope, inverse_width)
        queue = (self._apart_cells, self._apart_keys, self._state)
        while not kernels.spread(self._sizes, self._cells, self._keys, *queue, *aim):
            self._enlarge()
        while True:
            verdict = kernels.grow(
                costs.reshape(-1), width, height, self._halves, self._field.reshape(-1), self._sizes, self._cells,
                self._keys, *queue, *aim, cancelled.flag)
            if verdict != kernels.BUCKET_FULL:
                return int(verdict)
            self._enlarge()

    def _enlarge(self) -> None:
        self._cells = np.concatenate((self._cells, np.zeros_like(self._cells)), axis=1)
        self._keys = np.concatenate((self._keys, np.zeros_like(self._keys)), axis=1)

    def _follow(self, costs: np.ndarray, start: Cell) -> np.ndarray:
        room = 4 * max(costs.shape) + 16
        while True:
            path = np.empty((room, 2), dtype=np.int32)
            count = kernels.follow(costs, self._halves, self._field, start[0], start[1], path)
            if count >= 0:
                return path[:count]
            room *= 4


def path_cost(costs: np.ndarray, weights: np.ndarray, cells: np.ndarray) -> float:
    """Return what a path over neighbouring cells, shape (N, 2), counts: the field's measure in double precision."""
    counted = weights[costs[cells[:, 1], cells[:, 0]]].astype(np.float64)
    steps = np.abs(np.diff(cells, axis=0)).sum(axis=1)
    lengths = np.where(steps == 2, np.sqrt(2.0), 1.0)
    return float(((counted[1:] + counted[:-1]) * 0.5 * lengths).sum())
