# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled inflation: the exact Euclidean distance to the nearest lethal cell, turned into costs by a table.

The distance transform is the two-pass one (columns, then rows; Felzenszwalb and Huttenlocher, "Distance transforms of
sampled functions", 2012, equation 2), with the row pass written as shifted minima over whole rows, because the radius
is a few dozen cells and vector instructions take dozens of cells at a time. The window is worked through in bands of
rows that fit the second-level cache; bands and columns without an obstacle within the radius are skipped.

Each innermost loop is a kernel of its own over slices: the compiler does not vectorize loops within loops.
"""

from __future__ import annotations

import numpy as np

from mbf_relay.kernels import kernel

MAXIMUM_RADIUS = 180  # cells: 2 * 180² < 2^16

_BAND = 64  # rows
_INSCRIBED = 253
_LETHAL = 254
_NO_INFORMATION = 255


@kernel("boolean(uint8[::1])")
def _holds_lethal(row):
    found = np.uint8(0)
    for x in range(row.shape[0]):
        found |= np.uint8(row[x] == _LETHAL)
    return found != 0


@kernel("void(uint8[::1], uint16[::1], uint16)")
def _next_row(row, since, reach):
    """Advance the distance (cells) to the last lethal cell of each column by one row, up to `reach` at most."""
    one, zero = np.uint16(1), np.uint16(0)
    for x in range(since.shape[0]):
        older = np.uint16(since[x] + one)
        older = older if older < reach else reach
        since[x] = zero if row[x] == _LETHAL else older


@kernel("uint16(uint16[::1], uint16[::1])")
def _take_nearer(above, below):
    """Set `above` to the lesser of `above` and `below`, element by element; return the least of all."""
    smallest = np.uint16(65535)
    for x in range(above.shape[0]):
        nearer = above[x] if above[x] < below[x] else below[x]
        above[x] = nearer
        smallest = nearer if nearer < smallest else smallest
    return smallest


@kernel("void(uint16[::1], uint16[::1], uint16, uint16)")
def _square(distances, squared, reach, far):
    for x in range(distances.shape[0]):
        distance = distances[x]
        squared[x] = np.uint16(distance * distance) if distance < reach else far


@kernel("void(uint16[::1], uint16[::1], uint16[::1], uint16)")
def _lower_to(left, right, squared, step):
    for x in range(squared.shape[0]):
        nearer = left[x] if left[x] < right[x] else right[x]
        nearer = np.uint16(nearer + step)
        squared[x] = nearer if nearer < squared[x] else squared[x]


@kernel("void(uint8[::1], uint16[::1], uint8[::1], int64, int64)")
def _raise_costs(row, squared, table, limit, threshold):
    for x in range(row.shape[0]):
        distance = squared[x]
        if distance <= limit:
            cost = table[distance]
            old = row[x]
            if old == _NO_INFORMATION:
                if cost >= threshold:
                    row[x] = cost
            elif cost > old:
                row[x] = cost


@kernel("UniTuple(int64, 2)(uint8[:,::1], int64, int64, int64, int64)")
def _lethal_columns(costs, start, end, left, right):
    """Return the first and last column, between `left` and `right`, with a lethal cell in rows `start` to `end`."""
    first, last = right, left - 1
    for y in range(start, end):
        if _holds_lethal(costs[y, left:right]):
            x = left
            while x < first and costs[y, x] != _LETHAL:
                x += 1
            first = min(first, x)
            x = right - 1
            while x > last and costs[y, x] != _LETHAL:
                x -= 1
            last = max(last, x)
    return first, last


@kernel("void(uint8[:,::1], int64, int64, int64, int64, uint8[::1], int64, boolean)")
def inflate(costs, x0, y0, x1, y1, table, radius, inflate_unknown):
    """Raise the cells of a window to the cost of their distance from the nearest lethal cell, in place.

    Args:
        costs: Shape (height, width); lethal cells up to `radius` outside of the window count as well.
        x0, y0, x1, y1: Columns and rows of the window, the ends not included, within the grid.
        table: Cost by squared distance in cells, radius² + 1 long.
        radius: Cells, 1 to 180, so that squared distances and their sums stay below 2^16.
        inflate_unknown: Unknown cells take any cost above 0 instead of only those from INSCRIBED up.
    """
    height, width = costs.shape
    reach = np.uint16(radius + 1)
    far = np.uint16(65535 - radius * radius - 1)
    threshold = 1 if inflate_unknown else _INSCRIBED
    span = min(x1 + radius, width) - max(x0 - radius, 0)
    band = np.empty((_BAND, span), np.uint16)
    since_all = np.empty(span, np.uint16)
    padded_all = np.empty(span + 2 * radius, np.uint16)
    squared_all = np.empty(span, np.uint16)
    for start in range(y0, y1, _BAND):
        end = min(start + _BAND, y1)
        halo_start, halo_end = max(start - radius, 0), min(end + radius, height)
        first, last = _lethal_columns(costs, halo_start, halo_end, max(x0 - radius, 0), min(x1 + radius, width))
        if last < first:
            continue
        # columns of the window within the radius of a lethal cell, and the columns whose distances they depend on
        from_x, to_x = max(first - radius, x0), min(last + radius + 1, x1)
        left, right = max(from_x - radius, 0), min(to_x + radius, width)
        columns, wanted = right - left, to_x - from_x
        if wanted <= 0:
            continue
        since = since_all[:columns]
        since[:] = reach
        for y in range(halo_end - 1, start - 1, -1):
            _next_row(costs[y, left:right], since, reach)
            if y < end:
                band[y - start, :columns] = since
        since[:] = reach
        for y in range(halo_start, start):
            _next_row(costs[y, left:right], since, reach)
        padded = padded_all[:wanted + 2 * radius]
        padded[:] = far
        squared = squared_all[:wanted]
        inset = left - (from_x - radius)
        for y in range(start, end):
            nearest = band[y - start, :columns]
            _next_row(costs[y, left:right], since, reach)
            if _take_nearer(nearest, since) >= reach:
                continue
            _square(nearest, padded[inset:inset + columns], reach, far)
            squared[:] = padded[radius:radius + wanted]
            for shift in range(1, radius + 1):
                _lower_to(
                    padded[radius - shift:radius - shift + wanted], padded[radius + shift:radius + shift + wanted],
                    squared, np.uint16(shift * shift))
            _raise_costs(costs[y, from_x:to_x], squared, table, radius * radius, threshold)
