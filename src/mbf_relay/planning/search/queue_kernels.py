# mypy: allow-untyped-defs, allow-untyped-calls
"""The queue of a label-correcting search, and kernels shared by the fields that use it.

The queue is a ring of buckets about one straight step wide (Denardo and Fox, 1979); within a bucket the order is that
of arrival, so that the processor can load cells in advance. Entries with keys beyond the ring wait in a store. A new
start changes all keys: the ring is then emptied into the store, and filled from it again.

An entry is a cell (row * 65536 + column) and the value it had when it was queued. Where the cell's value is another one
now, the entry is out of date, and the cell has a newer entry.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

BUCKETS = 64
ROOT_VALUE = 1.0  # of the goal's own cell: any value above 0

# The layout of `state`, int64, one for all searches. numba keeps compiled kernels by their own file alone, so each
# module that uses it copies what it needs, under the same names with an underscore; a test compares the copies.
WAITING = 0  # entries in the ring
BASE = 1  # number of the lowest bucket
TAKEN = 2  # entries of the lowest bucket already processed
APART = 3  # entries in the store
NEXT_SPREAD = 4  # number of the lowest bucket from which on the ring must be filled from the store again
MIN_COLUMN, MIN_ROW, MAX_COLUMN, MAX_ROW = 5, 6, 7, 8  # bounding box of the expanded cells
EXPANDED = 9  # number of expansions since the field was reset
STATE_SIZE = 10

# verdicts of the kernels that grow a field
REACHED, EXHAUSTED, CANCELLED, BUCKET_FULL, SPREAD_DUE, STORE_FULL = 0, 1, 2, 3, 4, 5

CANCEL_CHECK = 4096  # expansions between two checks of the flag: a fraction of a millisecond
SPARE = 64  # entries a kernel may add to a bucket before it checks again for room

_BUCKETS = 64
_WAITING, _BASE, _TAKEN, _APART, _NEXT_SPREAD = 0, 1, 2, 3, 4
_OCTILE = np.float32(math.sqrt(2.0) - 1.0)
_SPARE = 64
_NEVER = 1 << 60


@kernel("int64(uint8[::1], int64)")
def _lowest(cells, lowest):
    for i in range(cells.shape[0]):
        lowest = min(lowest, np.int64(cells[i]))
    return lowest


@kernel("int64(uint8[:,::1], boolean[::1], int64, int64, int64)")
def lowest_connected(costs, free, start_x, start_y, enough):
    """Return a lower bound of the costs of cells connected with a free cell, not below `enough`.

    For each row one span of columns is kept that covers the connected cells in it. Spans are extended to the free cells
    that touch the spans of the rows beside them, until none grows. All cells in a span count, connected or not, so that
    the bound may be lower than necessary; but only the spans' ends are searched cell by cell.

    Args:
        costs: Shape (height, width).
        free: Shape (256,): whether cells of each cost may be entered.
        start_x, start_y: Column and row of the free cell.
        enough: Value that is returned as soon as the bound reaches it, and for mazes, where the search would take long.
    """
    height, width = costs.shape
    firsts = np.full(height, width, np.int32)
    lasts = np.full(height, -1, np.int32)
    waits = np.zeros(height, np.uint8)
    rows = np.empty(height, np.int32)
    firsts[start_y] = lasts[start_y] = start_x
    left, right = start_x, start_x
    while left > 0 and free[costs[start_y, left - 1]]:
        left -= 1
    while right + 1 < width and free[costs[start_y, right + 1]]:
        right += 1
    firsts[start_y], lasts[start_y] = left, right
    lowest = _lowest(costs[start_y, left:right + 1], 255)
    rows[0] = start_y
    waits[start_y] = 1
    count, left_to_do = 1, 8 * height
    while count > 0 and lowest > enough:
        left_to_do -= 1
        if left_to_do < 0:
            return enough  # a maze
        count -= 1
        row = np.int64(rows[count])
        waits[row] = 0
        for y in range(row - 1, row + 2, 2):
            if y < 0 or y >= height:
                continue
            left, right = np.int64(firsts[row]), np.int64(lasts[row])
            while left <= right and not free[costs[y, left]]:
                left += 1
            if left > right:
                continue
            while not free[costs[y, right]]:
                right -= 1
            while left > 0 and free[costs[y, left - 1]]:
                left -= 1
            while right + 1 < width and free[costs[y, right + 1]]:
                right += 1
            first, last = min(left, np.int64(firsts[y])), max(right, np.int64(lasts[y]))
            if first < firsts[y] or last > lasts[y]:
                firsts[y], lasts[y] = first, last
                lowest = _lowest(costs[y, first:last + 1], lowest)
                if waits[y] == 0:
                    waits[y] = 1
                    rows[count] = y
                    count += 1
    return max(lowest, enough)


@kernel("boolean(uint8[::1], uint8[::1])")
def _differ(old, new):
    differs = np.uint8(0)
    for x in range(old.shape[0]):
        differs |= old[x] ^ new[x]
    return differs != 0


@kernel("int64(uint8[:,::1], uint8[:,::1], int64, int64, int64, int64, int32[:,::1])")
def changed_cells(costs, seen, x0, y0, x1, y1, changed):
    """Find the cells of a window whose costs changed; return how many, or -1 where these are more than M.

    Args:
        costs, seen: Costs now and before, shape (height, width).
        x0, y0, x1, y1: Columns and rows of the window, the ends not included.
        changed: Shape (M, 2), filled with columns and rows, row by row.
    """
    count = 0
    for y in range(y0, y1):
        if not _differ(seen[y, x0:x1], costs[y, x0:x1]):
            continue
        for x in range(x0, x1):
            if costs[y, x] != seen[y, x]:
                if count == changed.shape[0]:
                    return -1
                changed[count, 0], changed[count, 1] = x, y
                count += 1
    return count


@kernel("boolean(int64[::1], int32[:,::1], float32[:,::1], int32[::1], float32[::1], int64[::1], int64, int64,"
        " float32, float32)")
def spread(sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y, slope, inverse_width):
    """Move entries from the store into the ring, where it covers their keys: values plus octile distance times `slope`.

    If the ring is empty, it first moves up to the lowest entry.

    Args:
        sizes, cells, keys: The ring: number of entries in each bucket, shape (64,); their cells and the cells' values,
            shape (64, capacity).
        apart_cells, apart_keys, state: The store, shape (its capacity,) each, and the counters; see the module.
        start_x, start_y: Column and row of the start.
        slope: The heuristic's cost per cell.
        inverse_width: One over the width of a bucket.

    Returns:
        False where a bucket is full: nothing was moved then. Make the buckets larger and call again.
    """
    count = state[_APART]
    base = state[_BASE]
    buckets = np.empty(count, np.int64)
    lowest = _NEVER
    for i in range(count):
        dx, dy = abs(np.int64(apart_cells[i] & 65535) - start_x), abs(np.int64(apart_cells[i] >> 16) - start_y)
        heuristic = np.float32(slope * (np.float32(max(dx, dy)) + _OCTILE * np.float32(min(dx, dy))))
        buckets[i] = np.int64(np.float32(apart_keys[i] + heuristic) * inverse_width)
        lowest = min(lowest, buckets[i])
    if state[_WAITING] == 0:
        base = lowest if lowest < _NEVER else base
        sizes[state[_BASE] & (_BUCKETS - 1)] = 0
        state[_TAKEN] = 0
        state[_BASE] = base
    added = np.zeros(_BUCKETS, np.int64)
    for i in range(count):
        buckets[i] = max(buckets[i], base)
        if buckets[i] - base < _BUCKETS:
            added[buckets[i] & (_BUCKETS - 1)] += 1
    for slot in range(_BUCKETS):
        if sizes[slot] + added[slot] + _SPARE > cells.shape[1]:
            return False
    kept = 0
    next_bucket = _NEVER
    for i in range(count):
        if buckets[i] - base < _BUCKETS:
            slot = buckets[i] & (_BUCKETS - 1)
            cells[slot, sizes[slot]], keys[slot, sizes[slot]] = apart_cells[i], apart_keys[i]
            sizes[slot] += 1
            state[_WAITING] += 1
        else:
            apart_cells[kept], apart_keys[kept] = apart_cells[i], apart_keys[i]
            kept += 1
            next_bucket = min(next_bucket, buckets[i])
    state[_APART] = kept
    state[_NEXT_SPREAD] = next_bucket  # no sooner, so that each call fills a whole ring
    return True


@kernel("int64(float32[:,::1], int64[::1], int32[:,::1], float32[:,::1], int32[::1], float32[::1], int64[::1])")
def set_apart(field, sizes, cells, keys, apart_cells, apart_keys, state):
    """Empty the ring into the store, without entries out of date; return the number of entries in the store.

    A negative result is minus the room needed in the store, which was too small; nothing was moved then.
    """
    if state[_APART] + state[_WAITING] > apart_cells.shape[0]:
        return -(state[_APART] + state[_WAITING])
    count = state[_APART]
    for slot in range(_BUCKETS):
        first = state[_TAKEN] if slot == (state[_BASE] & (_BUCKETS - 1)) else 0
        for i in range(first, sizes[slot]):
            apart_cells[count], apart_keys[count] = cells[slot, i], keys[slot, i]
            count += 1
        sizes[slot] = 0
    kept = 0
    for i in range(count):
        if field[apart_cells[i] >> 16, apart_cells[i] & 65535] == apart_keys[i]:
            apart_cells[kept], apart_keys[kept] = apart_cells[i], apart_keys[i]
            kept += 1
    state[_APART] = kept
    state[_WAITING] = 0
    state[_TAKEN] = 0
    return kept


@kernel("int64(float32[:,::1], int32[:,::1], int32[::1], int64, int32[::1], float32[::1], int64[::1])")
def requeue(field, changed, forgotten, count, apart_cells, apart_keys, state):
    """Put every known cell in or next to cells that changed or were reset into the store; return its new size.

    Args:
        field: Shape (height, width); reset cells hold 0.
        changed: Shape (N, 2): columns and rows of cells whose costs changed.
        forgotten, count: The first `count` entries are cells that were reset, row * 65536 + column.
        apart_cells, apart_keys, state: The store, with room for 9 entries for each of these cells, and the counters.
    """
    height, width = field.shape
    waiting = state[_APART]
    for n in range(count + changed.shape[0]):
        if n < count:
            middle_x, middle_y = np.int64(forgotten[n] & 65535), np.int64(forgotten[n] >> 16)
        else:
            middle_x, middle_y = np.int64(changed[n - count, 0]), np.int64(changed[n - count, 1])
        if 0 < middle_x < width - 1 and 0 < middle_y < height - 1:
            known = np.float32(0.0)  # one in thirty of these cells has a known neighbour: summed without branches
            for y in range(middle_y - 1, middle_y + 2):
                for x in range(middle_x - 1, middle_x + 2):
                    known += field[np.uint64(y), np.uint64(x)]
            if known == 0.0:
                continue
        for y in range(max(middle_y - 1, 0), min(middle_y + 2, height)):  # type: ignore[call-overload]
            for x in range(max(middle_x - 1, 0), min(middle_x + 2, width)):  # type: ignore[call-overload]
                value = field[np.uint64(y), np.uint64(x)]
                if value > 0:
                    apart_cells[np.uint64(waiting)], apart_keys[np.uint64(waiting)] = y * 65536 + x, value
                    waiting += 1
    state[_APART] = waiting
    return waiting
