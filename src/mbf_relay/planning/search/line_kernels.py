# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops for straight lines over weighted cells: their cost, and string pulling."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_CORNER = 1e-9  # cells from a corner within which a line counts as passing through it
_MOVE = 0.37  # cells: no sum of it, its half and its quarter is half a cell, which would put a point on a border
_GAIN = 1e-4  # share of the cost of a point's two lines that a move must save


@kernel("float64(uint8[:,::1], float32[::1], float64, float64, float64, float64)")
def line_cost(costs, weights, x0, y0, x1, y1):
    """Return the cost of a straight line: its length in each cell times the cell's weight, inf where it is blocked.

    Through a corner it may pass only where both cells beside it may be entered too.

    Args:
        costs: Shape (height, width).
        weights: Shape (256,), inf where a cell must not be entered.
        x0, y0, x1, y1: The ends in cells, centres at halves, within the map.
    """
    column, row = int(x0), int(y0)  # rounds down, and without a call, since no point within the map lies below 0
    end_column, end_row = int(x1), int(y1)
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    if weights[costs[row, column]] == np.inf or weights[costs[end_row, end_column]] == np.inf:
        return np.inf
    step_x = 1 if dx > 0 else -1
    step_y = 1 if dy > 0 else -1
    # where along the line, from 0 to 1, it leaves the cell through a side; inf in the column and the row of its end,
    # which it does not leave: beyond them the map may end
    across_x = abs(1.0 / dx) if dx != 0.0 else np.inf
    across_y = abs(1.0 / dy) if dy != 0.0 else np.inf
    next_x = ((column + 1 - x0) if dx > 0 else (x0 - column)) * across_x if column != end_column else np.inf
    next_y = ((row + 1 - y0) if dy > 0 else (y0 - row)) * across_y if row != end_row else np.inf
    at = 0.0
    total = 0.0
    # a start on a cell's border may be counted to the cell behind
    steps = abs(end_column - column) + abs(end_row - row) + 2
    for _ in range(steps):
        weight = weights[costs[row, column]]
        leave = min(next_x, next_y)
        if leave >= 1.0 or (column == end_column and row == end_row):
            return total + (1.0 - at) * length * weight
        total += (leave - at) * length * weight
        at = leave
        if abs(next_x - next_y) * length < _CORNER:
            if weights[costs[row, column + step_x]] == np.inf or weights[costs[row + step_y, column]] == np.inf:
                return np.inf
            column += step_x
            row += step_y
            next_x = next_x + across_x if column != end_column else np.inf
            next_y = next_y + across_y if row != end_row else np.inf
        elif next_x < next_y:
            column += step_x
            next_x = next_x + across_x if column != end_column else np.inf
        else:
            row += step_y
            next_y = next_y + across_y if row != end_row else np.inf
        if weights[costs[row, column]] == np.inf:
            return np.inf
    return total + (1.0 - at) * length * weights[costs[row, column]]


@kernel("float64(uint8[:,::1], float32[::1], float64[:,::1])")
def polyline_cost(costs, weights, points):
    """Return the cost of a path of straight lines; `points` has shape (N, 2), in cells."""
    total = 0.0
    for n in range(points.shape[0] - 1):
        total += line_cost(costs, weights, points[n, 0], points[n, 1], points[n + 1, 0], points[n + 1, 1])
    return total


@kernel("int64(uint8[:,::1], float32[::1], float64[:,::1], int64)")
def pull_string(costs, weights, points, passes):
    """Straighten a path in place by string pulling, which never raises its cost; return how many points are left.

    Points are dropped where the straight line between their neighbours costs no more. When none can be dropped, points
    are moved by a part of a cell where that makes their two lines cheaper by the share _GAIN; until nothing changes.
    What failed is not tried again until the point or a neighbour has changed.

    Args:
        costs, weights: As for `line_cost`.
        points: Shape (N, 2), in cells; the first and the last stay.
        passes: Largest number of passes over the path.
    """
    count = points.shape[0]
    lines = np.empty(count, np.float64)  # cost of the line from each point to the next
    for n in range(count - 1):
        lines[n] = line_cost(costs, weights, points[n, 0], points[n, 1], points[n + 1, 0], points[n + 1, 1])
    stays = np.zeros(count, np.bool_)  # dropping it failed
    rests = np.zeros(count, np.bool_)  # moving it by `reach` failed
    reach = _MOVE
    for _ in range(passes):
        changed = False
        # every other point first: dropping neighbours in turn would eat up one end of a curve
        for parity in range(2):
            kept = 1
            spared = parity == 1
            for n in range(1, count - 1):
                dropped = False
                if not spared and not stays[n]:
                    straight = line_cost(
                        costs, weights, points[kept - 1, 0], points[kept - 1, 1], points[n + 1, 0], points[n + 1, 1])
                    if straight <= lines[kept - 1] + lines[n] + 1e-9:
                        lines[kept - 1] = straight
                        dropped = True
                        changed = True
                        stays[kept - 1] = stays[n + 1] = False
                        rests[kept - 1] = rests[n + 1] = False
                    else:
                        stays[n] = True
                if not dropped:
                    points[kept, 0], points[kept, 1] = points[n, 0], points[n, 1]
                    lines[kept], stays[kept], rests[kept] = lines[n], stays[n], rests[n]
                    kept += 1
                spared = dropped
            if count > 1:
                points[kept, 0], points[kept, 1] = points[count - 1, 0], points[count - 1, 1]
                count = kept + 1
        if changed:
            continue
        moved = False
        for n in range(1, count - 1):
            if rests[n]:
                continue
            rests[n] = True
            x, y = points[n, 0], points[n, 1]
            least = lines[n - 1] + lines[n]
            least -= _GAIN * least
            best_x, best_y = x, y
            for k in range(4):
                to_x = x + (reach * (k * 2 - 1) if k < 2 else 0.0)
                to_y = y + (reach * (k * 2 - 5) if k > 1 else 0.0)
                if not (0.0 < to_x < costs.shape[1] and 0.0 < to_y < costs.shape[0]):
                    continue
                before = line_cost(costs, weights, points[n - 1, 0], points[n - 1, 1], to_x, to_y)
                if before < least:
                    after = line_cost(costs, weights, to_x, to_y, points[n + 1, 0], points[n + 1, 1])
                    if before + after < least:
                        least = before + after
                        best_x, best_y = to_x, to_y
            if best_x != x or best_y != y:
                points[n, 0], points[n, 1] = best_x, best_y
                lines[n - 1] = line_cost(costs, weights, points[n - 1, 0], points[n - 1, 1], best_x, best_y)
                lines[n] = line_cost(costs, weights, best_x, best_y, points[n + 1, 0], points[n + 1, 1])
                moved = True
                for k in range(n - 1, n + 2):
                    stays[k] = rests[k] = False
        if not moved:
            if reach <= 0.25 * _MOVE:
                break
            reach *= 0.5
            rests[:] = False
    return count
