# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled search: the cost-to-go field that grows from a goal over the 8-connected grid until it reaches a start.

The same field and queue serve plans from scratch, plans continued to another start, and updates after local changes of
the map. The search is label-correcting (Bertsekas, "Dynamic Programming and Optimal Control", section 2.3.1): a cell
whose value fell waits in a queue until its neighbours have been updated from it. The queue is ordered by value plus
heuristic, as in A* (Hart, Nilsson and Raphael, 1968). It is a ring of buckets about one straight step wide (Denardo and
Fox, 1979); within a bucket the order is that of arrival, so that the processor can load cells in advance. The heuristic
is the octile distance at the lowest cost that is connected with the goal, which is consistent: the start's value is
final once the lowest bucket lies above it.

Cells hold 0 where no value is known, as fresh memory does; the goal's cell holds ROOT_VALUE. Only memory near expanded
cells is touched, however large the map.

`grow` is one long function on purpose: split into several, it was a twentieth slower. The layout of queue and state is
that of queue_kernels; names with an underscore are copies of its constants, which a test compares.
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
_BATCH = 64


@kernel("int64(int64[::1], int32[:,::1], float32[:,::1], int64, int64)")
def _make_room(sizes, cells, keys, slot, taken):
    """Remove a bucket's `taken` processed entries where they are half of it or more; return how many remain of them.
    """
    if 2 * taken < sizes[slot]:
        return taken
    for i in range(taken, sizes[slot]):
        cells[slot, i - taken], keys[slot, i - taken] = cells[slot, i], keys[slot, i]
    sizes[slot] -= taken
    return 0


@kernel("float32(float32)")
def _or_inf(value):
    return value if value > 0 else np.float32(np.inf)


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
        costs: The map's costs, flattened row by row, shape (width * height,).
        width, height: Size of the map in cells, at most 32767 each.
        halves: Shape (256,): half the weight of each cost, inf where a cell must not be entered.
        field: Cost to go, shape of `costs`; 0 where not known.
        sizes, cells, keys, state: The queue's ring and its counters, see queue_kernels.
        start_x, start_y: Column and row of the start, towards which the search grows.
        slope: The heuristic's cost per straight step: no more than any step costs.
        inverse_width: One over the width of a bucket.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        A verdict of queue_kernels. After BUCKET_FULL make the buckets larger, after SPREAD_DUE call `spread`, and call
        again.
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
    packed_offsets = np.array([-1, 1, -65536, 65536, -65537, -65535, 65535, 65537], np.int32)
    batch_cells, batch_keys = np.empty(_BATCH, np.int32), np.empty(_BATCH, np.float32)
    through, held, gains = np.empty(8, np.float32), np.empty(8, np.float32), np.empty(8, np.int32)
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
            # with many equal keys one bucket fills while it is processed: first remove processed entries
            taken = _make_room(sizes, cells, keys, slot, taken)
            full = _is_full(sizes, capacity)
            if full:
                verdict = _BUCKET_FULL
                break
        if countdown <= 0:
            countdown = _CANCEL_CHECK
            if cancelled[0] != 0:
                verdict = _CANCELLED
                break
        # as in fast_marching_kernels: improved neighbours of several cells are queued in one batch
        batch = np.int64(0)
        size = sizes[np.uint64(slot)]
        while taken < size and batch <= _BATCH - 8 and countdown > 0:
            place = np.uint64(slot * capacity + taken)
            taken, waiting = taken + 1, waiting - 1
            packed = ring_cells[place]
            y, x = np.int64(packed >> 16), np.int64(packed & 65535)
            i = y * width + x
            value = field[np.uint64(i)]
            if ring_keys[place] != value:
                continue  # out of date: the cell was lowered since and has another entry
            countdown, expanded = countdown - 1, expanded + 1
            min_column, max_column = min(min_column, x), max(max_column, x)
            min_row, max_row = min(min_row, y), max(max_row, y)
            own = halves[costs[np.uint64(i)]]
            has_left, has_right, has_below, has_above = x > 0, x + 1 < width, y > 0, y + 1 < height
            inside = has_left and has_right and has_below and has_above
            if inside:
                left, right = halves[costs[np.uint64(i - 1)]], halves[costs[np.uint64(i + 1)]]
                below, above = halves[costs[np.uint64(i - width)]], halves[costs[np.uint64(i + width)]]
                left_below = halves[costs[np.uint64(i - width - 1)]]
                right_below = halves[costs[np.uint64(i - width + 1)]]
                left_above = halves[costs[np.uint64(i + width - 1)]]
                right_above = halves[costs[np.uint64(i + width + 1)]]
                at_left, at_right = field[np.uint64(i - 1)], field[np.uint64(i + 1)]
                at_below, at_above = field[np.uint64(i - width)], field[np.uint64(i + width)]
                at_left_below, at_right_below = field[np.uint64(i - width - 1)], field[np.uint64(i - width + 1)]
                at_left_above, at_right_above = field[np.uint64(i + width - 1)], field[np.uint64(i + width + 1)]
            else:
                left, right = halves[costs[i - 1]] if has_left else inf, halves[costs[i + 1]] if has_right else inf
                below = halves[costs[i - width]] if has_below else inf
                above = halves[costs[i + width]] if has_above else inf
                left_below = halves[costs[i - width - 1]] if has_left and has_below else inf
                right_below = halves[costs[i - width + 1]] if has_right and has_below else inf
                left_above = halves[costs[i + width - 1]] if has_left and has_above else inf
                right_above = halves[costs[i + width + 1]] if has_right and has_above else inf
                at_left, at_right = field[i - 1] if has_left else zero, field[i + 1] if has_right else zero
                at_below, at_above = field[i - width] if has_below else zero, field[i + width] if has_above else zero
                at_left_below = field[i - width - 1] if has_left and has_below else zero
                at_right_below = field[i - width + 1] if has_right and has_below else zero
                at_left_above = field[i + width - 1] if has_left and has_above else zero
                at_right_above = field[i + width + 1] if has_right and has_above else zero
            # values of the neighbours through this cell, their values after the update, and whether they improved;
            # eight of a kind in a row without branches, so that the compiler can vectorize
            to_left, to_right = value + (own + left), value + (own + right)
            to_below, to_above = value + (own + below), value + (own + above)
            to_left_below = value + (own + left_below) * _DIAGONAL if max(left, below) < inf else inf
            to_right_below = value + (own + right_below) * _DIAGONAL if max(right, below) < inf else inf
            to_left_above = value + (own + left_above) * _DIAGONAL if max(left, above) < inf else inf
            to_right_above = value + (own + right_above) * _DIAGONAL if max(right, above) < inf else inf
            through[0], through[1], through[2], through[3] = to_left, to_right, to_below, to_above
            through[4], through[5] = to_left_below, to_right_below
            through[6], through[7] = to_left_above, to_right_above
            gains_left = to_left < _or_inf(at_left)
            gains_right = to_right < _or_inf(at_right)
            gains_below = to_below < _or_inf(at_below)
            gains_above = to_above < _or_inf(at_above)
            gains_left_below = to_left_below < _or_inf(at_left_below)
            gains_right_below = to_right_below < _or_inf(at_right_below)
            gains_left_above = to_left_above < _or_inf(at_left_above)
            gains_right_above = to_right_above < _or_inf(at_right_above)
            held[0] = to_left if gains_left else at_left
            held[1] = to_right if gains_right else at_right
            held[2] = to_below if gains_below else at_below
            held[3] = to_above if gains_above else at_above
            held[4] = to_left_below if gains_left_below else at_left_below
            held[5] = to_right_below if gains_right_below else at_right_below
            held[6] = to_left_above if gains_left_above else at_left_above
            held[7] = to_right_above if gains_right_above else at_right_above
            gains[0], gains[1] = np.int32(gains_left), np.int32(gains_right)
            gains[2], gains[3] = np.int32(gains_below), np.int32(gains_above)
            gains[4], gains[5] = np.int32(gains_left_below), np.int32(gains_right_below)
            gains[6], gains[7] = np.int32(gains_left_above), np.int32(gains_right_above)
            if inside:
                field[np.uint64(i - 1)], field[np.uint64(i + 1)] = held[0], held[1]
                field[np.uint64(i - width)], field[np.uint64(i + width)] = held[2], held[3]
                field[np.uint64(i - width - 1)], field[np.uint64(i - width + 1)] = held[4], held[5]
                field[np.uint64(i + width - 1)], field[np.uint64(i + width + 1)] = held[6], held[7]
            else:
                for k in range(8):
                    if gains[k] != 0:
                        field[i + offsets[k]] = held[k]
            for k in range(8):
                chosen = np.uint64(k)
                batch_cells[np.uint64(batch)] = packed + packed_offsets[chosen]
                batch_keys[np.uint64(batch)] = through[chosen]
                batch += gains[chosen]
        for n in range(batch):
            lowered, near = batch_keys[np.uint64(n)], batch_cells[np.uint64(n)]
            dx, dy = abs(np.int64(near & 65535) - start_x), abs(np.int64(near >> 16) - start_y)
            key = lowered + slope * (np.float32(max(dx, dy)) + _OCTILE * np.float32(min(dx, dy)))
            # keys beyond the ring go into its last bucket: to be processed early does no harm
            bucket = min(max(np.int64(key * inverse_width), base), base + (_BUCKETS - 1))
            near_slot = np.uint64(bucket & (_BUCKETS - 1))
            size = sizes[near_slot]
            near_place = np.uint64(np.int64(near_slot) * capacity + size)
            ring_cells[near_place] = near
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
    """Return the cost of the step from cell (x, y) to its neighbour (x + dx, y + dy), inf where it is not allowed."""
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
    """Return whether a cell's value is justified: by a neighbour's value plus the step to it, or as the goal's."""
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
    """Reset values of a field that are too low after costs changed.

    A value is justified by a lower one, so that cells cannot justify each other in a circle (Ramalingam and Reps, "An
    incremental algorithm for a generalization of the shortest-path problem", 1996).

    Args:
        costs: The present costs, shape (height, width).
        halves: As for `grow`.
        field: Shape (height, width), changed in place: cells that are reset hold 0.
        changed: Shape (N, 2): columns and rows of the cells whose costs changed.
        unsupported: Longer than 9 N; filled with the cells that were reset, as row * 65536 + column.

    Returns:
        How many cells were reset, or -1 where `unsupported` is too short; the field is then useless.
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
    """Collect the cells of the cheapest path from a start to the goal, both included.

    Args:
        costs, halves, field: As for `invalidate`, after `grow` reached the start.
        start_x, start_y: Column and row of the start.
        path: Shape (M, 2), filled with columns and rows.

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
