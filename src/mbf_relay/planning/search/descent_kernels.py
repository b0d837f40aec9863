# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled gradient descent on a potential, in steps of half a cell as navfn's."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_STEP = 0.5  # cells between two points of the path, as in navfn


@kernel("boolean(float32[:,::1], int64, int64)")
def _is_known(field, x, y):
    return 0 <= x < field.shape[1] and 0 <= y < field.shape[0] and field[y, x] > 0


@kernel("float64(float32[:,::1], float64, float64)")
def potential_at(field, x, y):
    """Return the potential at (x, y), in cells, interpolated bilinearly; inf where a cell it needs is not known."""
    column, row = int(math.floor(x - 0.5)), int(math.floor(y - 0.5))
    right, up = x - 0.5 - column, y - 0.5 - row
    total = 0.0
    for dy in range(2):
        for dx in range(2):
            share = (right if dx else 1.0 - right) * (up if dy else 1.0 - up)
            if share > 0.0:
                if not _is_known(field, column + dx, row + dy):
                    return np.inf
                total += share * field[row + dy, column + dx]
    return total


@kernel("UniTuple(float64, 2)(float32[:,::1], int64, int64)")
def _slope_at(field, x, y):
    """Return the potential's gradient (per cell, in x and y) at a cell's centre, from its known neighbours."""
    middle = field[y, x]
    slope_x, slope_y = 0.0, 0.0
    sides = 0
    if _is_known(field, x - 1, y):
        slope_x += middle - field[y, x - 1]
        sides += 1
    if _is_known(field, x + 1, y):
        slope_x += field[y, x + 1] - middle
        sides += 1
    slope_x /= max(sides, 1)
    sides = 0
    if _is_known(field, x, y - 1):
        slope_y += middle - field[y - 1, x]
        sides += 1
    if _is_known(field, x, y + 1):
        slope_y += field[y + 1, x] - middle
        sides += 1
    return slope_x, slope_y / max(sides, 1)


@kernel("UniTuple(float64, 2)(float32[:,::1], float64, float64)")
def _next_down(field, x, y):
    """Return the point one step down the gradient, in cells; NaN where the gradient is 0 or a cell it needs is unknown.
    """
    column, row = int(math.floor(x - 0.5)), int(math.floor(y - 0.5))
    right, up = x - 0.5 - column, y - 0.5 - row
    slope_x, slope_y = 0.0, 0.0
    for dy in range(2):
        for dx in range(2):
            share = (right if dx else 1.0 - right) * (up if dy else 1.0 - up)
            if share == 0.0:
                continue  # on the line between two centres: the cells beside it have no weight
            if not _is_known(field, column + dx, row + dy):
                return np.nan, np.nan
            one_x, one_y = _slope_at(field, column + dx, row + dy)
            slope_x += share * one_x
            slope_y += share * one_y
    steepness = math.hypot(slope_x, slope_y)
    if steepness < 1e-9:
        return np.nan, np.nan
    return x - _STEP * slope_x / steepness, y - _STEP * slope_y / steepness


@kernel("UniTuple(int64, 2)(float32[:,::1], float64, float64)")
def _cell_at(field, x, y):
    """Return the cell, (column, row), that a point lies in; on a border, that of the lowest potential beside it."""
    column, row = int(math.floor(x)), int(math.floor(y))
    best_x, best_y = column, row
    if x == column or y == row:
        for to_y in range(row - 1 if y == row else row, row + 1):
            for to_x in range(column - 1 if x == column else column, column + 1):
                if _is_known(field, to_x, to_y) and not 0 < field[best_y, best_x] <= field[to_y, to_x]:
                    best_x, best_y = to_x, to_y
    return best_x, best_y


@kernel("int64(float32[:,::1], float64, float64, int64, int64, float64[:,::1])")
def descend(field, start_x, start_y, goal_x, goal_y, path):
    """Collect points down the potential from a start to the goal's cell, in cells (centres at halves).

    All points and the lines between them lie in cells of known potential. The potential falls from point to point, so
    that the descent ends; where the gradient leads no lower, the path goes on to the lowest neighbour cell's centre.

    Args:
        field: Shape (height, width), after `grow` reached the start.
        start_x, start_y: The first point, in cells.
        goal_x, goal_y: Column and row of the goal's cell.
        path: Shape (M, 2), filled with points in cells.

    Returns:
        How many points there are, or -1 where `path` is too short; the last lies in the goal's cell or next to it.
    """
    x, y = start_x, start_y
    column, row = int(math.floor(x)), int(math.floor(y))  # the start's own cell is known
    height_here = min(potential_at(field, x, y), np.float64(field[row, column]))
    count = 0
    while True:
        if count == path.shape[0]:
            return -1
        path[count, 0], path[count, 1] = x, y
        count += 1
        column, row = _cell_at(field, x, y)
        if abs(column - goal_x) + abs(row - goal_y) <= 1:
            return count
        next_x, next_y = _next_down(field, x, y)
        if not math.isnan(next_x):
            to_column, to_row = _cell_at(field, next_x, next_y)
            lower = potential_at(field, next_x, next_y)
            if lower < height_here and _is_known(field, column, to_row) and _is_known(field, to_column, row):
                x, y, height_here = next_x, next_y, lower
                continue
        # from cell to cell: to the lowest neighbour that can be entered without cutting a corner
        lowest = field[row, column]
        best_x, best_y = column, row
        for dy in (0, -1, 1):  # straight before diagonal, so that it wins ties
            for dx in (0, -1, 1):
                if _is_known(field, column + dx, row + dy) and _is_known(field, column + dx, row) and \
                        _is_known(field, column, row + dy) and field[row + dy, column + dx] < lowest:
                    lowest = field[row + dy, column + dx]
                    best_x, best_y = column + dx, row + dy
        if best_x == column and best_y == row:
            return count  # only the goal's cell has no lower neighbour
        x, y = best_x + 0.5, best_y + 0.5
        height_here = min(height_here, np.float64(lowest))
