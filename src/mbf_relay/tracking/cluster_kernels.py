# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the clusters: a scan cut into things, and the disc each of them is taken for."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

FEWEST = 3  # readings that make a thing
_BEAMS_APART = 2  # readings that follow each other at this distance or nearer, in beams, may be of one thing
_LEAST_RADIUS = 0.03  # m


@kernel(
    "void(float64[:,::1], boolean[::1], float64[::1], float64[::1], float64, float64, int64[::1], float64, float64, "
    "float64[::1])")
def measure(ends, hits, ranges, bearings, x, y, readings, gap, largest, disc):
    """Tell which disc's near side some readings lie on: as wide as seen, its centre where they put it on the mean.

    Args:
        ends, hits, ranges, bearings, x, y: The scan; see Rays.
        readings: Shape (M,): indices of neighbouring rays that hit the thing, at least one.
        gap: Distance (m) by which what stands before it is nearer than its edge.
        largest: Diameter (m) it has at most.
        disc: Shape (4,), written: x, y, radius (m), and 1 where nothing stands before one of its edges, else 0.
    """
    count, first, last = ranges.shape[0], readings[0], readings[-1]
    first_x, first_y = ends[first, 0] - x, ends[first, 1] - y
    last_x, last_y = ends[last, 0] - x, ends[last, 1] - y
    radius = max(_LEAST_RADIUS, 0.5 * math.hypot(last_x - first_x, last_y - first_y))
    radius = min(0.5 * largest, radius)
    near, far = max(math.hypot(first_x, first_y), 1e-6), max(math.hypot(last_x, last_y), 1e-6)
    middle = math.atan2(first_y / near + last_y / far, first_x / near + last_x / far)
    depth = 0.0
    for reading in readings:
        off = bearings[reading] - middle
        aside = ranges[reading] * math.sin(off)
        depth += ranges[reading] * math.cos(off) + math.sqrt(max(0.0, radius * radius - aside * aside))
    depth /= readings.shape[0]
    before, after = (first - 1) % count, (last + 1) % count
    hidden = (hits[before] and ranges[before] < ranges[first] - gap) or (
        hits[after] and ranges[after] < ranges[last] - gap)
    disc[0], disc[1] = x + depth * math.cos(middle), y + depth * math.sin(middle)
    disc[2], disc[3] = radius, 0.0 if hidden else 1.0


@kernel("float64(float64[::1], int64)")
def _smallest(values, rank):
    """Return the value of that rank, the lowest being 0, and put those below it before it (Hoare's selection)."""
    low, high = 0, values.shape[0] - 1
    while low < high:
        pivot = values[(low + high) // 2]
        left, right = low, high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while pivot < values[right]:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left += 1
                right -= 1
        if rank <= right:
            high = right
        elif rank >= left:
            low = left
        else:
            break
    return values[rank]


@kernel("float64(float64[::1])")
def _usual_turn(bearings):
    """Return the median angle (rad) from one bearing to the next, of two or more."""
    count = bearings.shape[0] - 1
    turns = np.empty(count)
    for index in range(count):
        turn = abs(bearings[index + 1] - bearings[index])
        turns[index] = min(turn, 2.0 * math.pi - turn)
    middle = count // 2
    upper = _smallest(turns, middle)
    return upper if count % 2 else 0.5 * (turns[:middle].max() + upper)


@kernel(
    "int64(float64[:,::1], boolean[::1], float64[::1], float64[::1], float64, float64, float64, float64, "
    "float64[:,::1], int64[:,::1], int64[::1])")
def find_things(ends, hits, ranges, bearings, x, y, gap, largest, discs, runs, order):
    """Tell which runs of neighbouring readings are things, and return how many.

    Args:
        ends, hits, ranges, bearings, x, y: The scan of N rays; see Rays.
        gap: Distance (m) between neighbouring readings that parts two things, where the beams lie close.
        largest: Extent (m) above which a run is a wall.
        discs: Shape (N, 4), written: one row for each thing; see measure.
        runs: Shape (N, 2), written: where a thing's readings begin and end in `order`.
        order: Shape (N,), written: the rays that hit something, thing by thing.
    """
    count, found = hits.shape[0], 0
    hitting = np.empty(count, np.int64)
    for index in range(count):
        if hits[index]:
            hitting[found] = index
            found += 1
    if found < FEWEST:
        return 0
    beam = _usual_turn(bearings)
    ends_a_run, first_break = np.zeros(found, np.bool_), -1
    for index in range(found):
        one, other = hitting[index], hitting[(index + 1) % found]
        apart = math.hypot(ends[other, 0] - ends[one, 0], ends[other, 1] - ends[one, 1])
        allowed = max(gap, 3.0 * beam * min(ranges[one], ranges[other]))
        ends_a_run[index] = apart > allowed or (other - one) % count > _BEAMS_APART
        if ends_a_run[index] and first_break < 0:
            first_break = index
    if first_break < 0:
        return 0
    things, begin = 0, 0
    for index in range(found):
        place = (first_break + 1 + index) % found
        order[index] = hitting[place]
        if not ends_a_run[place]:
            continue
        run = order[begin:index + 1]
        low_x, high_x, low_y, high_y = math.inf, -math.inf, math.inf, -math.inf
        for reading in run:
            low_x, high_x = min(low_x, ends[reading, 0]), max(high_x, ends[reading, 0])
            low_y, high_y = min(low_y, ends[reading, 1]), max(high_y, ends[reading, 1])
        if run.shape[0] >= FEWEST and math.hypot(high_x - low_x, high_y - low_y) <= largest:
            measure(ends, hits, ranges, bearings, x, y, run, gap, largest, discs[things])
            runs[things, 0], runs[things, 1] = begin, index + 1
            things += 1
        begin = index + 1
    return things
