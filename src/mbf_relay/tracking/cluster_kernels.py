# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels of the clustering: segmentation of a scan into objects, and the disc that approximates each."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

FEWEST = 3  # least number of readings of an object
_BEAMS_APART = 2  # largest difference of beam indices between consecutive readings of one object
_LEAST_RADIUS = 0.03  # m, of a disc


@kernel(
    "void(float64[:,::1], boolean[::1], float64[::1], float64[::1], float64, float64, int64[::1], float64, float64, "
    "float64[::1])")
def measure(ends, hits, ranges, bearings, x, y, readings, gap, largest, disc):
    """Fit a disc to some readings: its diameter is their extent, its near side lies on them on average.

    Args:
        ends, hits, ranges, bearings, x, y: The scan; see Rays.
        readings: Indices of the object's neighbouring rays, one at least, shape (M,).
        gap: Distance (m) by which an occluding object is nearer than this one's edge.
        largest: Largest diameter (m).
        disc: Written: x, y, radius (m), and 0 where one of its edges is occluded, else 1; shape (4,).
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
    """Return the value of a rank, from 0, and partition the values in place around it (quickselect, Hoare)."""
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
    """Return the median angle (rad) between consecutive bearings, of which there are two at least."""
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
    """Segment a scan into objects at jumps between neighbouring readings; return their number.

    Args:
        ends, hits, ranges, bearings, x, y: The scan of N rays; see Rays.
        gap: Distance (m) between neighbouring readings that separates two objects; more where beams are far apart.
        largest: Extent (m) above which a segment is a wall.
        discs: Written: a row for each object, see `measure`; shape (N, 4).
        runs: Written: begin and end of each object's readings in `order`; shape (N, 2).
        order: Written: indices of the rays that hit, object by object; shape (N,).
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
