# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled search: the cost-to-go field that grows from a goal over the 8-connected grid until it reaches a start.

One state serves plans from scratch, plans continued to another start, and updates after local changes of the map. It
is that of a label-correcting search (Bertsekas, "Dynamic Programming and Optimal Control", section 2.3.1): every cell
whose value fell since its neighbours last looked at it waits in a queue, ordered by value plus heuristic as in A*
(Hart, Nilsson and Raphael, 1968). The queue is a ring of buckets about one straight step wide (Denardo and Fox, 1979),
worked through in the order of arrival, so that one cell need not wait for the memory of the one before. The heuristic
is the octile distance at the lowest cost on the map, which is consistent: the field is exact once the lowest bucket
lies above the start's value.

Cells hold 0 where no value is known, so that fresh memory needs no filling; the goal itself holds ROOT_VALUE. Only
memory near what was looked at is touched, however large the map.

`grow` is one long function on purpose: with its parts in functions of their own, it was a twentieth slower. The layout
of queue and state is queue_kernels'; names with an underscore are copies of its, which a test compares.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_BUCKETS = 64
_ROOT = np.float32(1.0)
_WAITING, _BASE, _TAKEN, _APART, _NEXT_SPREAD = 0, 1, 2, 3, 4
_MIN_COLUMN, _MIN_ROW, _MAX_COLUMN, _MAX_ROW, _EXPANDED = 5, 6, 7, 8, 9
_REACHED, _EXHAUSTED, _CANCELLED, _BUCKET_FULL, _SPREAD_DUE = 0, 1, 2, 3, 4
_DIAGONAL = np.float32(math.sqrt(2.0))
_OCTILE = np.float32(math.sqrt(2.0) - 1.0)
_CANCEL_CHECK = 4096
_SPARE = 64


@kernel("int64(int64[::1], int32[:,::1], float32[:,::1], int64, int64)")
def _make_room(sizes, cells, keys, slot, taken):
    """Drop a bucket's entries already worked through, where that is worth it; return how many there still are of them.
    """
    if 2 * taken < sizes[slot]:
        return taken
    for i in range(taken, sizes[slot]):
        cells[slot, i - taken], keys[slot, i - taken] = cells[slot, i], keys[slot, i]
    sizes[slot] -= taken
    return 0


@kernel("boolean(int64[::1], int64)")
def _is_full(sizes, capacity):
    full = False
    for slot in range(_BUCKETS):
        full |= sizes[slot] + _SPARE > capacity
    return full


@kernel("int64(uint8[::1], int64, int64, float32[::1], float32[::1], int64[::1], int32[:,::1], float32[:,::1],"
        " int64[::1], int64, int64, float32, float32, uint8[::1])")
def grow(
    costs, width, height, halves, field, sizes, cells, keys, state, start_x, start_y, slope, inverse_width, cancelled
):
    """Grow the field until the start's value is final.

        the goal waits in the queue, with its value
        while the start's value is not known, or the lowest bucket may still make it lower:
            take the next entry of the lowest bucket, or go on to the bucket above where there is none
            if the cell's value is another one than the entry's: it waits elsewhere; go on
            for each of its eight neighbours that may be entered from it:
                through = the cell's value + what the step counts
                if the neighbour has no value, or a higher one than that:
                    its value becomes `through`
                    it waits in the bucket of `through` + heuristic, behind what waits there

    Args:
        costs: The map's costs, row by row, width * height of them; at most 32767 each way.
        width, height: Of the map, in cells.
        halves: Shape (256,): half of what a straight step over a cell of each cost counts, inf where it may not be
            entered.
        field: Cost to go, as long as `costs`; 0 where not known.
        sizes, cells, keys, state: The queue's ring and its counters, see queue_kernels.
        start_x, start_y: Where to.
        slope: What the heuristic counts for a straight step: not more than any step does.
        inverse_width: One over the width of a bucket.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        A verdict of queue_kernels; after BUCKET_FULL make the buckets larger, after SPREAD_DUE spread the store, and
        call again.
    """
    inf = np.float32(np.inf)
    zero = np.float32(0.0)
    start = np.uint64(start_y * width + start_x)
    waiting, base, taken, expanded = state[_WAITING], state[_BASE], state[_TAKEN], state[_EXPANDED]
    min_column, min_row = state[_MIN_COLUMN], state[_MIN_ROW]
    max_column, max_row = state[_MAX_COLUMN], state[_MAX_ROW]
    capacity = np.int64(cells.shape[1])
    ring_cells, ring_keys = cells.ravel(), keys.ravel()
    offsets = np.array([-1, 1, -width, width, -width - 1, -width + 1, width - 1, width + 1])
    columns = np.array([-1, 1, 0, 0, -1, 1, -1, 1])
    rows = np.array([0, 0, -1, 1, -1, -1, 1, 1])
    through = np.empty(8, np.float32)
    better = np.empty(9, np.int64)
    full = _is_full(sizes, capacity)
    countdown = _CANCEL_CHECK
    verdict = -1
    if field[start] > zero and waiting > 0 and np.float32(base) > field[start] * inverse_width:
        verdict = _REACHED  # a field grown before reaches here
    while verdict < 0:
        slot = base & (_BUCKETS - 1)
        if taken == sizes[np.uint64(slot)]:
            sizes[np.uint64(slot)] = 0
            taken = 0
            reached = field[start]
            if reached > zero and np.float32(base + 1) > reached * inverse_width:
                verdict = _REACHED
                break
            if waiting > 0:
                base += 1
            if waiting == 0 or base >= state[_NEXT_SPREAD]:
                verdict = _EXHAUSTED if waiting == 0 and state[_APART] == 0 else _SPREAD_DUE
                break
            continue
        if full:
            # where many keys are equal, one bucket fills while it is emptied: first drop what is done with
            taken = _make_room(sizes, cells, keys, slot, taken)
            full = _is_full(sizes, capacity)
            if full:
                verdict = _BUCKET_FULL
                break
        if countdown == 0:
            countdown = _CANCEL_CHECK
            if cancelled[0] != 0:
                verdict = _CANCELLED
                break
        place = np.uint64(slot * capacity + taken)
        taken += 1
        waiting -= 1
        packed = ring_cells[place]
        y, x = np.int64(packed >> 16), np.int64(packed & 65535)
        i = y * width + x
        value = field[np.uint64(i)]
        if ring_keys[place] != value:
            continue  # it was lowered since, and waits elsewhere with its present value
        countdown -= 1
        expanded += 1
        min_column, max_column = min(min_column, x), max(max_column, x)
        min_row, max_row = min(min_row, y), max(max_row, y)
        own = halves[costs[np.uint64(i)]]
        inside = x > 0 and x + 1 < width and y > 0 and y + 1 < height
        if inside:
            left, right = halves[costs[np.uint64(i - 1)]], halves[costs[np.uint64(i + 1)]]
            below, above = halves[costs[np.uint64(i - width)]], halves[costs[np.uint64(i + width)]]
            left_below, right_below = halves[costs[np.uint64(i - width - 1)]], halves[costs[np.uint64(i - width + 1)]]
            left_above, right_above = halves[costs[np.uint64(i + width - 1)]], halves[costs[np.uint64(i + width + 1)]]
        else:
            left = halves[costs[i - 1]] if x > 0 else inf
            right = halves[costs[i + 1]] if x + 1 < width else inf
            below = halves[costs[i - width]] if y > 0 else inf
            above = halves[costs[i + width]] if y + 1 < height else inf
            left_below = halves[costs[i - width - 1]] if x > 0 and y > 0 else inf
            right_below = halves[costs[i - width + 1]] if x + 1 < width and y > 0 else inf
            left_above = halves[costs[i + width - 1]] if x > 0 and y + 1 < height else inf
            right_above = halves[costs[i + width + 1]] if x + 1 < width and y + 1 < height else inf
        through[0], through[1] = value + (own + left), value + (own + right)
        through[2], through[3] = value + (own + below), value + (own + above)
        through[4] = value + (own + left_below) * _DIAGONAL if max(left, below) < inf else inf
        through[5] = value + (own + right_below) * _DIAGONAL if max(right, below) < inf else inf
        through[6] = value + (own + left_above) * _DIAGONAL if max(left, above) < inf else inf
        through[7] = value + (own + right_above) * _DIAGONAL if max(right, above) < inf else inf
        # which neighbours get better, without a branch for each: such branches cannot be predicted
        count = np.int64(0)
        if inside:
            for k in range(8):
                near = field[np.uint64(i + offsets[np.uint64(k)])]
                near = near if near > zero else inf
                better[np.uint64(count)] = k
                count += np.int64(through[np.uint64(k)] < near)
        else:
            for k in range(8):
                if through[k] < inf:
                    near = field[i + offsets[k]]
                    near = near if near > zero else inf
                    better[count] = k
                    count += np.int64(through[k] < near)
        for n in range(count):
            chosen = np.uint64(better[np.uint64(n)])
            lowered = through[chosen]
            field[np.uint64(i + offsets[chosen])] = lowered
            near_x, near_y = x + columns[chosen], y + rows[chosen]
            dx, dy = abs(near_x - start_x), abs(near_y - start_y)
            key = lowered + slope * (np.float32(max(dx, dy)) + _OCTILE * np.float32(min(dx, dy)))
            # too early does no harm, too late would: what lies beyond the ring goes into its last bucket
            bucket = min(max(np.int64(key * inverse_width), base), base + (_BUCKETS - 1))
            near_slot = np.uint64(bucket & (_BUCKETS - 1))
            size = sizes[near_slot]
            near_place = np.uint64(np.int64(near_slot) * capacity + size)
            ring_cells[near_place] = near_y * 65536 + near_x
            ring_keys[near_place] = lowered
            sizes[near_slot] = size + 1
            full |= size + 1 + _SPARE > capacity
            waiting += 1
    state[_WAITING], state[_BASE], state[_TAKEN], state[_EXPANDED] = waiting, base, taken, expanded
    state[_MIN_COLUMN], state[_MIN_ROW] = min_column, min_row
    state[_MAX_COLUMN], state[_MAX_ROW] = max_column, max_row
    return verdict


@kernel("float32(uint8[:,::1], float32[::1], int64, int64, int64, int64)")
def step_cost(costs, halves, x, y, dx, dy):
    """Return what the step from a cell to a neighbour counts, inf where it may not be taken."""
    height, width = costs.shape
    to_x, to_y = x + dx, y + dy
    if not (0 <= to_x < width and 0 <= to_y < height):
        return np.float32(np.inf)
    both = np.float32(halves[costs[y, x]] + halves[costs[to_y, to_x]])
    if dx == 0 or dy == 0:
        return both
    if halves[costs[y, to_x]] == np.inf or halves[costs[to_y, x]] == np.inf:
        return np.float32(np.inf)
    return np.float32(both * _DIAGONAL)


@kernel("boolean(uint8[:,::1], float32[::1], float32[:,::1], int64, int64)")
def _is_supported_by_steps(costs, halves, field, x, y):
    """Return whether a neighbour still explains a cell's value: some way on costs no more than it says."""
    value = field[y, x]
    if value == _ROOT:
        return True
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            step = step_cost(costs, halves, x, y, dx, dy) if dx != 0 or dy != 0 else np.float32(np.inf)
            if step < np.inf:
                near = field[y + dy, x + dx]
                if near > 0 and np.float32(near + step) <= value:
                    return True
    return False


@kernel("int64(uint8[:,::1], float32[::1], float32[:,::1], int32[:,::1], int32[::1])")
def invalidate(costs, halves, field, changed, unsupported):
    """Forget what is no longer true in a field after costs changed.

    What a cell's value rests on lies lower than the value, so support cannot run in circles (Ramalingam and Reps,
    "An incremental algorithm for a generalization of the shortest-path problem", 1996).

    Args:
        costs, halves: The map as it is now.
        field: Changed in place.
        changed: Shape (N, 2): columns and rows of the cells whose costs changed.
        unsupported: Scratch, longer than 9 N.
        apart_cells, apart_keys, state: The store; entries are added to it.

    Returns:
        How many cells were forgotten, or -1 where the scratch or the store is too small: the field is lost then.
    """
    height, width = costs.shape
    count = 0
    for n in range(changed.shape[0]):
        for y in range(max(changed[n, 1] - 1, 0), min(changed[n, 1] + 2, height)):
            for x in range(max(changed[n, 0] - 1, 0), min(changed[n, 0] + 2, width)):
                if field[y, x] > 0 and not _is_supported_by_steps(costs, halves, field, x, y):
                    field[y, x] = 0
                    unsupported[count] = y * 65536 + x
                    count += 1
    done = 0
    while done < count:
        middle_x, middle_y = unsupported[done] & 65535, unsupported[done] >> 16
        done += 1
        for y in range(max(middle_y - 1, 0), min(middle_y + 2, height)):
            for x in range(max(middle_x - 1, 0), min(middle_x + 2, width)):
                if field[y, x] > 0 and not _is_supported_by_steps(costs, halves, field, x, y):
                    if count == unsupported.shape[0]:
                        return -1
                    field[y, x] = 0
                    unsupported[count] = y * 65536 + x
                    count += 1
    return count


@kernel("int64(uint8[:,::1], float32[::1], float32[:,::1], int64, int64, int32[:,::1])")
def follow(costs, halves, field, start_x, start_y, path):
    """Collect the cells of the cheapest way from a start to the goal, both included, as columns and rows.

    Args:
        costs, halves, field: As `grow` left them, the start's value being known.
        start_x, start_y: Where from.
        path: Shape (M, 2).

    Returns:
        How many cells there are, or -1 where `path` is too short.
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
        best = np.float32(np.inf)
        best_x, best_y = 0, 0
        for k in range(8):
            # straight steps first, so that they win ties
            dx = (k & 1) * 2 - 1 if k < 2 or k > 3 else 0
            dy = 0 if k < 2 else ((k & 1) * 2 - 1 if k < 4 else (k >> 1 & 1) * 2 - 1)
            step = step_cost(costs, halves, x, y, dx, dy)
            if step < np.inf:
                near = field[y + dy, x + dx]
                if near > 0 and near + step < best:
                    best = near + step
                    best_x, best_y = x + dx, y + dy
        x, y = best_x, best_y
