"""Compiled search: the cost-to-go field that grows from a goal over the 8-connected grid until it reaches a start.

One state serves plans from scratch, plans continued to another start, and repairs after local changes of the map. It
is that of a label-correcting search (Bertsekas, "Dynamic Programming and Optimal Control", section 2.3.1): every cell
whose value fell since its neighbours last looked at it waits in a queue. The queue is a row of buckets one straight
step wide, ordered by value plus heuristic as in A* (Hart, Nilsson and Raphael, 1968); since no step is cheaper than a
bucket is wide, hardly any cell is looked at twice. The heuristic is the octile distance at the cheapest cost, which is
consistent, so that the field is exact when the cheapest waiting key passes the start's value.

Cells hold 0 where no value is known, so that fresh memory needs no filling; the goal therefore holds a small value
above 0 itself. Only memory near what was looked at is touched, however large the map.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

ROOT_VALUE = 1.0  # of the goal's own cell: above 0, far below one step's cost

BUCKETS = 1024

# places in `state`, int64
FREE_ENTRY = 0  # first unused entry of the pool's list of such, -1 for none
USED_ENTRIES = 1  # entries of the pool ever used
WAITING = 2  # entries in buckets and overflow
BASE = 3  # number of the lowest bucket
OVERFLOW = 4  # first entry of the list of keys too high for the buckets, -1 for none
OVERFLOWING = 5  # entries in that list
MIN_COLUMN, MIN_ROW, MAX_COLUMN, MAX_ROW = 6, 7, 8, 9  # cells expanded
EXPANDED = 10  # how many, since the field was begun
STATE_SIZE = 11

# verdicts of `grow`
REACHED, EXHAUSTED, CANCELLED, POOL_FULL = 0, 1, 2, 3

_BUCKETS = 1024
_ROOT = np.float32(1.0)
_FREE, _USED, _WAITING, _BASE, _OVERFLOW, _OVERFLOWING = 0, 1, 2, 3, 4, 5
_MIN_COLUMN, _MIN_ROW, _MAX_COLUMN, _MAX_ROW, _EXPANDED = 6, 7, 8, 9, 10
_DIAGONAL = np.float32(math.sqrt(2.0))
_OCTILE = np.float32(math.sqrt(2.0) - 1.0)
_CANCEL_CHECK = 4095  # expansions between two looks at the flag, less one: about 0.1 ms
_SPARE = 8  # entries one expansion may take


@kernel("float32(int64, int64, int64, int64, float32)")
def _heuristic(x, y, start_x, start_y, cheapest):
    dx, dy = abs(x - start_x), abs(y - start_y)
    longer, shorter = max(dx, dy), min(dx, dy)
    # a hair below the octile distance, so that rounding never makes it more than the truth
    return np.float32(cheapest * np.float32(0.99999) * (np.float32(longer) + _OCTILE * np.float32(shorter)))


@kernel("void(int32[::1], int32[::1], int64[::1], int64, int64)")
def _link(heads, following, state, entry, bucket):
    """Put an entry into its bucket, or into the overflow where that is too far up."""
    bucket = max(bucket, state[_BASE])
    if bucket - state[_BASE] >= _BUCKETS:
        following[entry] = state[_OVERFLOW]
        state[_OVERFLOW] = entry
        state[_OVERFLOWING] += 1
    else:
        slot = bucket & (_BUCKETS - 1)
        following[entry] = heads[slot]
        heads[slot] = entry
    state[_WAITING] += 1


@kernel("void(int32[::1], int32[::1], float32[::1], int32[::1], int64[::1], int64, int64, float32, float32, float32)")
def _push(heads, cells, keys, following, state, x, y, value, heuristic, inverse_width):
    entry = state[_FREE]
    if entry >= 0:
        state[_FREE] = following[entry]
    else:
        entry = state[_USED]
        state[_USED] += 1
    cells[entry] = y * 65536 + x
    keys[entry] = value
    _link(heads, following, state, entry, int((value + heuristic) * inverse_width))


@kernel("void(float32[:,::1], int32[::1], int32[::1], float32[::1], int32[::1], int64[::1], int64, int64, float32)")
def sort_overflow(field, heads, cells, keys, following, state, start_x, start_y, cheapest):
    """Spread the overflow over the buckets, which must be empty, lowest key first; forget entries out of date."""
    inverse_width = np.float32(1.0) / cheapest
    lowest = np.float32(math.inf)
    entry = state[_OVERFLOW]
    kept = -1
    while entry >= 0:
        rest = following[entry]
        y, x = cells[entry] >> 16, cells[entry] & 65535
        if field[y, x] == keys[entry]:
            lowest = min(lowest, np.float32(keys[entry] + _heuristic(x, y, start_x, start_y, cheapest)))
            following[entry] = kept
            kept = entry
        else:
            following[entry] = state[_FREE]
            state[_FREE] = entry
        entry = rest
    state[_OVERFLOW] = -1
    state[_OVERFLOWING] = 0
    state[_WAITING] = 0
    if kept >= 0:
        state[_BASE] = int(lowest * inverse_width)
    while kept >= 0:
        rest = following[kept]
        y, x = cells[kept] >> 16, cells[kept] & 65535
        key = np.float32(keys[kept] + _heuristic(x, y, start_x, start_y, cheapest))
        _link(heads, following, state, kept, int(key * inverse_width))
        kept = rest


@kernel("void(float32[:,::1], int32[::1], int32[::1], float32[::1], int32[::1], int64[::1], int64, int64, float32)")
def aim(field, heads, cells, keys, following, state, start_x, start_y, cheapest):
    """Order what waits anew, for another start."""
    for slot in range(_BUCKETS):
        entry = heads[slot]
        while entry >= 0:
            rest = following[entry]
            following[entry] = state[_OVERFLOW]
            state[_OVERFLOW] = entry
            entry = rest
        heads[slot] = -1
    sort_overflow(field, heads, cells, keys, following, state, start_x, start_y, cheapest)


@kernel("int64(float32[:,::1], uint8[:,::1], int64, int64, int32[:,::1])")
def follow(field, parents, start_x, start_y, path):
    """Collect the cells from a start to the goal, both included, as columns and rows; return how many they are.

    Args:
        field, parents: As `grow` left them, the start's value being known.
        start_x, start_y: Where from.
        path: Shape (M, 2); where M is too small, the result is -1.
    """
    x, y = start_x, start_y
    count = 0
    while True:
        if count == path.shape[0]:
            return -1
        path[count, 0], path[count, 1] = x, y
        count += 1
        if field[y, x] == _ROOT:
            return count
        direction = parents[y, x]
        if direction < 4:
            x += 1 if direction == 1 else (-1 if direction == 0 else 0)
            y += 1 if direction == 3 else (-1 if direction == 2 else 0)
        else:
            x += 1 if direction & 1 else -1
            y += 1 if direction >= 6 else -1


@kernel("int64(uint8[:,::1], float32[::1], float32[:,::1], uint8[:,::1], int32[::1], int32[::1], float32[::1],"
        " int32[::1], int64[::1], int64, int64, float32, uint8[::1])")
def grow(costs, halves, field, parents, heads, cells, keys, following, state, start_x, start_y, cheapest, cancelled):
    """Grow the field until the start's value is final.

    Args:
        costs: Shape (height, width), at most 32767 each way.
        halves: Shape (256,): half of what a straight step over a cell of each cost counts; 0 where it may not be
            entered.
        field: Cost to go, of `costs`' shape; 0 where not known.
        parents: Direction to the next cell toward the goal, of `costs`' shape; valid where the field is.
        heads: Shape (BUCKETS,), first entry of each bucket, -1 for none.
        cells, keys, following: The pool: cell (row * 65536 + column), its value when it was put there, next entry.
        state: See above.
        start_x, start_y: Where to; its cell must be free.
        cheapest: Cost of a straight step at the lowest cost, the width of a bucket.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        A verdict; after POOL_FULL make the pool larger and call again.
    """
    height, width = costs.shape
    inverse_width = np.float32(1.0) / cheapest
    expanded = state[_EXPANDED]
    min_column, min_row = state[_MIN_COLUMN], state[_MIN_ROW]
    max_column, max_row = state[_MAX_COLUMN], state[_MAX_ROW]
    verdict = -1
    while verdict < 0:
        if state[_WAITING] == 0:
            verdict = 1
            break
        if state[_WAITING] == state[_OVERFLOWING]:
            sort_overflow(field, heads, cells, keys, following, state, start_x, start_y, cheapest)
            continue
        slot = state[_BASE] & (_BUCKETS - 1)
        entry = heads[slot]
        if entry < 0:
            state[_BASE] += 1
            reached = field[start_y, start_x]
            if reached > 0 and np.float32(state[_BASE]) * cheapest > reached:
                verdict = 0
            continue
        if state[_USED] + _SPARE > cells.shape[0]:
            verdict = 3
            break
        heads[slot] = following[entry]
        following[entry] = state[_FREE]
        state[_FREE] = entry
        state[_WAITING] -= 1
        y, x = cells[entry] >> 16, cells[entry] & 65535
        value = field[y, x]
        if keys[entry] != value:
            continue  # it was lowered since, and waits elsewhere with its present value
        expanded += 1
        if expanded & _CANCEL_CHECK == 0 and cancelled[0] != 0:
            # what was taken out goes back: the field stays good for another try
            _push(heads, cells, keys, following, state, x, y, value,
                  _heuristic(x, y, start_x, start_y, cheapest), inverse_width)
            verdict = 2
            break
        min_column, max_column = min(min_column, x), max(max_column, x)
        min_row, max_row = min(min_row, y), max(max_row, y)
        own = halves[costs[y, x]]
        left = halves[costs[y, x - 1]] if x > 0 else np.float32(0.0)
        right = halves[costs[y, x + 1]] if x + 1 < width else np.float32(0.0)
        below = halves[costs[y - 1, x]] if y > 0 else np.float32(0.0)
        above = halves[costs[y + 1, x]] if y + 1 < height else np.float32(0.0)
        for direction in range(8):
            if direction == 0:
                half, dx, dy = left, -1, 0
            elif direction == 1:
                half, dx, dy = right, 1, 0
            elif direction == 2:
                half, dx, dy = below, 0, -1
            elif direction == 3:
                half, dx, dy = above, 0, 1
            elif direction == 4:
                half, dx, dy = halves[costs[y - 1, x - 1]] if left > 0 and below > 0 else np.float32(0.0), -1, -1
            elif direction == 5:
                half, dx, dy = halves[costs[y - 1, x + 1]] if right > 0 and below > 0 else np.float32(0.0), 1, -1
            elif direction == 6:
                half, dx, dy = halves[costs[y + 1, x - 1]] if left > 0 and above > 0 else np.float32(0.0), -1, 1
            else:
                half, dx, dy = halves[costs[y + 1, x + 1]] if right > 0 and above > 0 else np.float32(0.0), 1, 1
            if half > 0:
                step = own + half
                if direction > 3:
                    step = np.float32(step * _DIAGONAL)
                through = np.float32(value + step)
                near = field[y + dy, x + dx]
                if near == 0 or through < near:
                    field[y + dy, x + dx] = through
                    parents[y + dy, x + dx] = direction ^ 1 if direction < 4 else 11 - direction
                    _push(heads, cells, keys, following, state, x + dx, y + dy, through,
                          _heuristic(x + dx, y + dy, start_x, start_y, cheapest), inverse_width)
    state[_EXPANDED] = expanded
    state[_MIN_COLUMN], state[_MIN_ROW] = min_column, min_row
    state[_MAX_COLUMN], state[_MAX_ROW] = max_column, max_row
    return verdict
