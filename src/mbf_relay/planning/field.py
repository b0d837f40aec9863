"""The cost-to-go field of one goal: grown as far as a plan needs it, kept for the next one."""

from __future__ import annotations

from typing import Optional, Tuple

import numpy as np

from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import field_kernels as kernels
from mbf_relay.planning.planner import Cancellation

Cell = Tuple[int, int]
"""Column and row."""


class CostToGo:
    """Costs from cells of a grid to a goal over 8-connected steps, exact for every cell a plan needed.

    A step between two cells costs the mean of what the cells count, times its length; a diagonal step needs both
    orthogonal neighbours free. Cost and path are those of a search from scratch whatever is kept between calls.

    Attributes:
        expanded: Cells looked at in the last call, for benchmarks.
    """

    def __init__(self) -> None:
        self._costs = np.zeros((0, 0), dtype=np.uint8)
        self._weights: Optional[np.ndarray] = None
        self._goal: Optional[Cell] = None
        self._field = np.zeros((0, 0), dtype=np.float32)
        self._parents = np.zeros((0, 0), dtype=np.uint8)
        self._heads = np.full(kernels.BUCKETS, -1, dtype=np.int32)
        self._cells = np.zeros(1 << 14, dtype=np.int32)
        self._keys = np.zeros(1 << 14, dtype=np.float32)
        self._following = np.zeros(1 << 14, dtype=np.int32)
        self._state = np.zeros(kernels.STATE_SIZE, dtype=np.int64)
        self.expanded = 0

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
            PlanningError: CANCELED.
        """
        self._begin(costs, weights, goal)
        cheapest = weights[weights > 0.0].min()
        halves = (weights * np.float32(0.5)).astype(np.float32)
        while True:
            verdict = kernels.grow(
                costs, halves, self._field, self._parents, self._heads, self._cells, self._keys, self._following,
                self._state, start[0], start[1], cheapest, cancelled.flag)
            if verdict != kernels.POOL_FULL:
                break
            self._cells, self._keys, self._following = (
                np.concatenate((pool, np.zeros_like(pool))) for pool in (self._cells, self._keys, self._following))
        self.expanded = int(self._state[kernels.EXPANDED])
        if verdict == kernels.CANCELLED:
            self._goal = None
            raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
        if verdict == kernels.EXHAUSTED and self._field[start[1], start[0]] == 0.0:
            return None
        return self._path(start), float(self._field[start[1], start[0]] - kernels.ROOT_VALUE)

    def _begin(self, costs: np.ndarray, weights: np.ndarray, goal: Cell) -> None:
        state = self._state
        if self._field.shape != costs.shape:
            self._field = np.zeros(costs.shape, dtype=np.float32)
            self._parents = np.zeros(costs.shape, dtype=np.uint8)
        elif state[kernels.EXPANDED] > 0:
            rows = slice(max(state[kernels.MIN_ROW] - 1, 0), state[kernels.MAX_ROW] + 2)
            columns = slice(max(state[kernels.MIN_COLUMN] - 1, 0), state[kernels.MAX_COLUMN] + 2)
            self._field[rows, columns] = 0.0
        height, width = costs.shape
        self._heads.fill(-1)
        state[:] = 0
        state[kernels.FREE_ENTRY] = -1
        state[kernels.MIN_COLUMN], state[kernels.MIN_ROW] = width, height
        state[kernels.MAX_COLUMN] = state[kernels.MAX_ROW] = -1
        # the goal waits alone, in the overflow, from where the search takes it into its bucket
        self._field[goal[1], goal[0]] = kernels.ROOT_VALUE
        self._cells[0], self._keys[0], self._following[0] = goal[1] * 65536 + goal[0], kernels.ROOT_VALUE, -1
        state[kernels.USED_ENTRIES] = state[kernels.WAITING] = state[kernels.OVERFLOWING] = 1
        self._goal = goal

    def _path(self, start: Cell) -> np.ndarray:
        room = 4 * max(self._field.shape) + 16
        while True:
            path = np.empty((room, 2), dtype=np.int32)
            count = kernels.follow(self._field, self._parents, start[0], start[1], path)
            if count >= 0:
                return path[:count]
            room *= 4
