# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled search for smooth paths: the arrival time of a front that spreads from the goal (fast marching).

The potential solves the eikonal equation |grad u| = cost on the grid (Sethian, "A fast marching level set method for
monotonically advancing fronts", 1996; navfn approximates the same update by a polynomial). It is grown, kept and
updated as the field of cost_to_go_kernels, with the same queue. Its heuristic is the straight distance at the lowest
cost that is connected with the goal.

`_grow_within` is one long function on purpose: split into several, it was a fifth slower. The layout of queue and state
is that of queue_kernels; names with an underscore are copies of its constants, which a test compares. So is the end of
`_spread_within` a copy of `spread`, since kernels only call kernels of their own file.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_BUCKETS = 64
_ROOT = np.float32(1.0)
_WAITING, _BASE, _TAKEN, _APART, _NEXT_SPREAD = 0, 1, 2, 3, 4
_MIN_COLUMN, _MIN_ROW, _MAX_COLUMN, _MAX_ROW, _EXPANDED = 5, 6, 7, 8, 9
_REACHED, _EXHAUSTED, _CANCELLED, _BUCKET_FULL, _SPREAD_DUE, _STORE_FULL = 0, 1, 2, 3, 4, 5
_CANCEL_CHECK = 4096
_SPARE = 64
_BATCH = 64
_NEVER = 1 << 60
# The limit of `grow` starts at _FIRST_LIMIT times the straight line's cost, and rises by the factor _RISE; after
# _MANY_CELLS expansions, beside which another step costs little, by _FINE_RISE.
_FIRST_LIMIT, _RISE, _FINE_RISE, _MANY_CELLS = 1.01, 1.2, 1.015, 30000
# Cells: the straight distance is convex, so value plus heuristic may fall a little along the front.
_FRONT_SLACK = np.float32(3.0)


@kernel("float32(float32, float32, float32)")
def _arrival(across, along, cost):
    """Return a cell's potential from its weight and its lower neighbour on either axis, inf where there is none."""
    apart = abs(across - along)
    one = min(across, along) + cost
    root = np.float32(math.sqrt(max(np.float32(2.0) * cost * cost - apart * apart, np.float32(0.0))))
    both = np.float32(0.5) * (across + along + root)
    return np.float32(both if apart < cost else one)  # never both where they are inf


@kernel("float32(float32)")
def _or_inf(value):
    return value if value > 0 else np.float32(np.inf)


@kernel("int64(int64[::1], int32[:,::1], float32[:,::1], int64, int64)")
def _make_room(sizes, cells, keys, slot, taken):
    """Remove a bucket's `taken` processed entries where they are half of it or more; return how many remain of them."""
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


@kernel("boolean(int64[::1], int32[:,::1], float32[:,::1], int32[::1], float32[::1], int64[::1], int64, int64,"
        " float32, float32, float32)")
def _spread_within(sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y, slope, inverse_width, limit):
    """Move entries from the store into the ring as queue_kernels.spread does, but ordered by their values alone.

    Entries whose value plus heuristic is above `limit` stay in the store.
    """
    count = state[_APART]
    base = state[_BASE]
    buckets = np.empty(count, np.int64)
    lowest = _NEVER
    for i in range(count):
        dx, dy = np.int64(apart_cells[i] & 65535) - start_x, np.int64(apart_cells[i] >> 16) - start_y
        buckets[i] = _NEVER
        if np.float32(apart_keys[i] + slope * np.float32(math.sqrt(np.float32(dx * dx + dy * dy)))) <= limit:
            buckets[i] = np.int64(apart_keys[i] * inverse_width)
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
    state[_NEXT_SPREAD] = next_bucket
    return True


@kernel("int64(uint8[::1], int64, int64, float32[::1], float32[::1], int64[::1], int32[:,::1], float32[:,::1],"
        " int32[::1], float32[::1], int64[::1], int64, int64, float32, float32, float32, uint8[::1])")
def _grow_within(
    costs, width, height, weights, field, sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y, slope,
    inverse_width, limit, cancelled,
):
    """Grow the potential where value plus heuristic is within a limit, until the start's value is final as far as that.

    The queue is ordered by the values alone: in the order of value plus heuristic, over free space all the same, cells
    would be taken before the front has come to them from both sides, again and again.

        the goal waits in the queue, with its value
        while the start's value is not known, or the lowest bucket may still make it lower:
            take the next entry of the lowest bucket, or go on to the bucket above where there is none
            if the cell's value is another one than the entry's: it waits elsewhere; go on
            for each of its four neighbours that may be entered:
                across = the lower of the neighbour's own neighbours on the other axis
                arrival = what a front has there that comes from the cell and from `across`; see `_arrival`
                if the neighbour has no value, or a higher one than that:
                    its value becomes `arrival`
                    it waits in the bucket of `arrival`; in the store where `arrival` + heuristic is above the limit

    Args:
        costs: The map's costs, flattened row by row, shape (width * height,).
        width, height: Size of the map in cells, at most 32767 each.
        weights: Shape (256,): weight of each cost, inf where a cell must not be entered.
        field: Potential, shape of `costs`; 0 where not known.
        sizes, cells, keys, apart_cells, apart_keys, state: The queue, see queue_kernels; what is beyond the limit goes
            into the store.
        start_x, start_y: Column and row of the start, towards which the search grows.
        slope: The heuristic's cost per cell: no more than any weight.
        inverse_width: One over the width of a bucket.
        limit: Value plus heuristic up to which cells are expanded.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        A verdict of queue_kernels. EXHAUSTED tells that the ring is empty, and that nothing in the store lies within
        the limit.
    """
    inf, zero = np.float32(np.inf), np.float32(0.0)
    start = np.uint64(start_y * width + start_x)
    waiting, base, taken, expanded = state[_WAITING], state[_BASE], state[_TAKEN], state[_EXPANDED]
    min_column, min_row, max_column, max_row = state[_MIN_COLUMN], state[_MIN_ROW], state[_MAX_COLUMN], state[_MAX_ROW]
    capacity = np.int64(cells.shape[1])
    ring_cells, ring_keys = cells.ravel(), keys.ravel()
    batch_cells, batch_keys = np.empty(_BATCH, np.int32), np.empty(_BATCH, np.float32)
    through, held, gains = np.empty(4, np.float32), np.empty(4, np.float32), np.empty(4, np.int32)
    full = _is_full(sizes, capacity)
    countdown, verdict, apart = _CANCEL_CHECK, -1, state[_APART]
    while verdict < 0:
        slot = base & (_BUCKETS - 1)
        if taken == sizes[np.uint64(slot)]:
            sizes[np.uint64(slot)] = 0
            taken = 0
            reached = field[start]
            if reached > 0 and np.float32(base + 1) > reached * inverse_width:
                verdict = _REACHED
                break
            if waiting > 0:
                base += 1
            if waiting == 0 or base >= state[_NEXT_SPREAD]:
                verdict = _EXHAUSTED if waiting == 0 and state[_NEXT_SPREAD] == _NEVER else _SPREAD_DUE
                break
            continue
        if full:
            # where many keys are equal, one bucket fills while it is emptied: first drop what is done with
            taken = _make_room(sizes, cells, keys, slot, taken)
            full = _is_full(sizes, capacity)
            if full:
                verdict = _BUCKET_FULL
                break
        if apart + _SPARE > apart_cells.shape[0]:
            verdict = _STORE_FULL
            break
        if countdown <= 0:
            countdown = _CANCEL_CHECK
            if cancelled[0] != 0:
                verdict = _CANCELLED
                break
        # improved neighbours of several cells are queued in one batch: their number per cell varies, and a short loop
        # of varying length for each cell would cost mispredicted branches
        batch = np.int64(0)
        size = sizes[np.uint64(slot)]
        while taken < size and batch <= _BATCH - 4 and countdown > 0:
            place = np.uint64(slot * capacity + taken)
            taken, waiting = taken + 1, waiting - 1
            packed = ring_cells[place]
            y, x = np.int64(packed >> 16), np.int64(packed & 65535)
            i = y * width + x
            own = field[np.uint64(i)]
            if ring_keys[place] != own:
                continue  # it was lowered since, and waits elsewhere with its present value
            countdown, expanded = countdown - 1, expanded + 1
            min_column, max_column = min(min_column, x), max(max_column, x)
            min_row, max_row = min(min_row, y), max(max_row, y)
            has_left, has_right, has_below, has_above = x > 0, x + 1 < width, y > 0, y + 1 < height
            inside = has_left and has_right and has_below and has_above
            if inside:
                left, right = field[np.uint64(i - 1)], field[np.uint64(i + 1)]
                below, above = field[np.uint64(i - width)], field[np.uint64(i + width)]
                left_below, right_below = field[np.uint64(i - width - 1)], field[np.uint64(i - width + 1)]
                left_above, right_above = field[np.uint64(i + width - 1)], field[np.uint64(i + width + 1)]
                cost_left, cost_right = weights[costs[np.uint64(i - 1)]], weights[costs[np.uint64(i + 1)]]
                cost_below, cost_above = weights[costs[np.uint64(i - width)]], weights[costs[np.uint64(i + width)]]
            else:
                left, right = field[i - 1] if has_left else zero, field[i + 1] if has_right else zero
                below, above = field[i - width] if has_below else zero, field[i + width] if has_above else zero
                left_below = field[i - width - 1] if has_left and has_below else zero
                right_below = field[i - width + 1] if has_right and has_below else zero
                left_above = field[i + width - 1] if has_left and has_above else zero
                right_above = field[i + width + 1] if has_right and has_above else zero
                cost_left = weights[costs[i - 1]] if has_left else inf
                cost_right = weights[costs[i + 1]] if has_right else inf
                cost_below = weights[costs[i - width]] if has_below else inf
                cost_above = weights[costs[i + width]] if has_above else inf
            left_below, right_below = _or_inf(left_below), _or_inf(right_below)
            left_above, right_above = _or_inf(left_above), _or_inf(right_above)
            # Values of the neighbours through this cell and the lower of their own neighbours across the step, their
            # values after the update, and whether they improved; four of a kind in a row without branches, so that the
            # compiler can vectorize.
            to_left = _arrival(own, min(left_below, left_above), cost_left)
            to_right = _arrival(own, min(right_below, right_above), cost_right)
            to_below = _arrival(own, min(left_below, right_below), cost_below)
            to_above = _arrival(own, min(left_above, right_above), cost_above)
            through[0], through[1], through[2], through[3] = to_left, to_right, to_below, to_above
            gains_left, gains_right = to_left < _or_inf(left), to_right < _or_inf(right)
            gains_below, gains_above = to_below < _or_inf(below), to_above < _or_inf(above)
            held[0], held[1] = to_left if gains_left else left, to_right if gains_right else right
            held[2], held[3] = to_below if gains_below else below, to_above if gains_above else above
            gains[0], gains[1] = np.int32(gains_left), np.int32(gains_right)
            gains[2], gains[3] = np.int32(gains_below), np.int32(gains_above)
            if inside:
                field[np.uint64(i - 1)], field[np.uint64(i + 1)] = held[0], held[1]
                field[np.uint64(i - width)], field[np.uint64(i + width)] = held[2], held[3]
            else:
                if has_left:
                    field[i - 1] = held[0]
                if has_right:
                    field[i + 1] = held[1]
                if has_below:
                    field[i - width] = held[2]
                if has_above:
                    field[i + width] = held[3]
            batch_cells[np.uint64(batch)], batch_keys[np.uint64(batch)] = packed - 1, through[0]
            batch += gains[0]
            batch_cells[np.uint64(batch)], batch_keys[np.uint64(batch)] = packed + 1, through[1]
            batch += gains[1]
            batch_cells[np.uint64(batch)], batch_keys[np.uint64(batch)] = packed - 65536, through[2]
            batch += gains[2]
            batch_cells[np.uint64(batch)], batch_keys[np.uint64(batch)] = packed + 65536, through[3]
            batch += gains[3]
        for n in range(batch):
            lowered = batch_keys[np.uint64(n)]
            near = batch_cells[np.uint64(n)]
            dx, dy = np.float32(np.int64(near & 65535) - start_x), np.float32(np.int64(near >> 16) - start_y)
            if lowered + slope * np.float32(math.sqrt(dx * dx + dy * dy)) > limit:
                apart_cells[apart] = near
                apart_keys[apart] = lowered
                apart += 1
                continue
            # keys beyond the ring go into its last bucket: to be processed early does no harm
            bucket = min(max(np.int64(lowered * inverse_width), base), base + (_BUCKETS - 1))
            near_slot = np.uint64(bucket & (_BUCKETS - 1))
            size = sizes[near_slot]
            near_place = np.uint64(np.int64(near_slot) * capacity + size)
            ring_cells[near_place] = near
            ring_keys[near_place] = lowered
            sizes[near_slot] = size + 1
            full |= size + 1 + _SPARE > capacity
            waiting += 1
    state[_WAITING], state[_BASE], state[_TAKEN], state[_EXPANDED] = waiting, base, taken, expanded
    state[_APART], state[_MIN_COLUMN], state[_MIN_ROW] = apart, min_column, min_row
    state[_MAX_COLUMN], state[_MAX_ROW] = max_column, max_row
    return verdict


@kernel("int64(uint8[::1], int64, int64, float32[::1], float32[::1], int64[::1], int32[:,::1], float32[:,::1],"
        " int32[::1], float32[::1], int64[::1], int64, int64, float32, float32, float64, float32, float64[::1],"
        " uint8[::1])")
def grow(
    costs, width, height, weights, field, sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y, slope,
    inverse_width, straight, expected, progress, cancelled,
):
    """Grow the potential until the start's value is final: within a limit that rises step by step until it lies above.

    Args:
        straight: Straight distance (cells) from start to goal.
        expected: The start's value before the last change of the map, often close to the new one; 0 for not known.
        progress: Shape (3,), kept between calls, zeros at first: limit, extra factor of its next rise, last verdict.
        costs, width, height, weights, field, sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y,
            slope, inverse_width, cancelled: See `_grow_within`.

    Returns:
        A verdict of queue_kernels; after BUCKET_FULL make the buckets larger, after STORE_FULL the store; call again.
    """
    slack = np.float32(_FRONT_SLACK * slope)
    start = np.uint64(start_y * width + start_x)
    limit, rise, verdict = np.float32(progress[0]), progress[1], int(progress[2])
    if limit == 0:
        limit = np.float32(_FIRST_LIMIT * np.float32(slope * np.float32(straight)) + 10.0 * slope)
        limit = max(limit if slope > 0 else np.float32(np.inf), np.float32(expected + slack))
        limit = max(limit, np.float32(field[start] + slack))
        rise, verdict = 1.0, _SPREAD_DUE
    result = -1
    while result < 0:
        if verdict == _SPREAD_DUE and not _spread_within(
                sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y, slope, inverse_width, limit):
            result = _BUCKET_FULL
            break
        verdict = _grow_within(
            costs, width, height, weights, field, sizes, cells, keys, apart_cells, apart_keys, state, start_x, start_y,
            slope, inverse_width, limit, cancelled)
        if verdict == _SPREAD_DUE:
            continue
        reached = field[start]
        if verdict != _REACHED and verdict != _EXHAUSTED:
            result = verdict
        elif reached > 0 and np.float32(reached + slack) <= limit:
            result = _REACHED
        elif reached > 0:
            limit = np.float32(reached + slack)
        elif state[_APART] == 0:
            result = _EXHAUSTED
        else:
            limit = np.float32(limit * (_FINE_RISE if state[_EXPANDED] > _MANY_CELLS else _RISE) * rise)
            rise = min(rise * 1.02, 2.0)  # walled off: the end must come in a few steps, however far the walls
        if result < 0:
            verdict = _SPREAD_DUE
    progress[0], progress[1], progress[2] = limit, rise, verdict
    return result


@kernel("float32(float32[:,::1], int64, int64, float32)")
def _below(field, x, y, value):
    """Return a cell's value where it is known and below `value`, else inf."""
    if 0 <= x < field.shape[1] and 0 <= y < field.shape[0]:
        found = field[np.uint64(y), np.uint64(x)]
        if 0 < found < value:
            return found
    return np.float32(np.inf)


@kernel("boolean(uint8[:,::1], float32[::1], float32[:,::1], int64, int64)")
def _is_supported_by_front(costs, weights, field, x, y):
    """Return whether a cell's value is justified, as the goal's or by its lower neighbours.

    That is where the fast-marching update from them gives no more.
    """
    value = field[np.uint64(y), np.uint64(x)]
    if value == _ROOT:
        return True
    across = min(_below(field, x - 1, y, value), _below(field, x + 1, y, value))
    along = min(_below(field, x, y - 1, value), _below(field, x, y + 1, value))
    return _arrival(across, along, weights[costs[np.uint64(y), np.uint64(x)]]) <= value


@kernel("int64(uint8[:,::1], float32[::1], float32[:,::1], int32[:,::1], int32[::1])")
def invalidate(costs, weights, field, changed, unsupported):
    """Reset values that are too low after costs changed, as cost_to_go_kernels.invalidate; `weights` as in `grow`."""
    height, width = costs.shape
    count = 0
    for n in range(changed.shape[0]):
        x, y = changed[n, 0], changed[n, 1]
        if field[y, x] > 0 and not _is_supported_by_front(costs, weights, field, x, y):
            field[y, x] = 0
            unsupported[count] = y * 65536 + x
            count += 1
    done = 0
    while done < count:
        middle_x, middle_y = unsupported[done] & 65535, unsupported[done] >> 16
        done += 1
        for side in range(4):
            x = middle_x + (side * 2 - 1 if side < 2 else 0)
            y = middle_y + (side * 2 - 5 if side > 1 else 0)
            if 0 <= x < width and 0 <= y < height:
                if field[np.uint64(y), np.uint64(x)] > 0 and not _is_supported_by_front(costs, weights, field, x, y):
                    if count == unsupported.shape[0]:
                        return -1
                    field[y, x] = 0
                    unsupported[count] = y * 65536 + x
                    count += 1
    return count
