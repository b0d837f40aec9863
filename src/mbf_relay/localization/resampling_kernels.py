# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over histograms: KLD resampling and clusters of poses, and thinning out of a scan's ends."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

BIN_LENGTH = 0.5
"""Side (m) of a bin of the pose histogram."""
BIN_ANGLE = math.pi / 18.0
"""Width (rad) of a bin in heading."""
ANGLE_BINS = 36
OFFSET = 1 << 20
"""Added to columns and rows of bins, so that keys are not negative up to 500 km from the origin."""
FRACTION = 0.6180339887498949
"""Golden ratio less 1: multiples of it modulo 1 are evenly spread."""
FARTHEST = 1 << 30
"""Largest distance of a point from the origin, in squares, for `first_in_squares`."""


@kernel("int64(float64, float64, float64)")
def key_of(x, y, theta):
    """Return the key of a pose's bin in the histogram, of 0.5 m x 0.5 m x 10 degrees as in amcl."""
    column = int(math.floor(x / BIN_LENGTH)) + OFFSET
    row = int(math.floor(y / BIN_LENGTH)) + OFFSET
    sector = int(math.floor((theta + math.pi) / BIN_ANGLE)) % ANGLE_BINS
    return (column * (2 * OFFSET) + row) * 64 + sector


@kernel("int64(int64, int64[::1])")
def slot_of(key, keys):
    """Return the slot of a key in a hash table with open addressing (-1: free), or the slot it would be put in."""
    mask = keys.shape[0] - 1
    slot = ((key * 7046029254386353131) >> 20) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@kernel("boolean(float64[:,::1], float64[::1])")
def in_one_corner(poses, corner):
    """Return whether poses fill at most two adjacent bins in each dimension, so that all of these touch.

    That is the usual case of a tracked robot, found by minima and maxima alone. Bins on both sides of the step from pi
    to -pi do not count as adjacent here.

    Args:
        poses: Shape (N, 3).
        corner: Result where it is so, shape (3,): index of the upper bin in column, row and heading.
    """
    if poses.shape[0] == 0:
        return False
    left, right, low, high = poses[0, 0], poses[0, 0], poses[0, 1], poses[0, 1]
    least, most = poses[0, 2], poses[0, 2]
    for i in range(poses.shape[0]):
        left, right = min(left, poses[i, 0]), max(right, poses[i, 0])
        low, high = min(low, poses[i, 1]), max(high, poses[i, 1])
        least, most = min(least, poses[i, 2]), max(most, poses[i, 2])
    corner[0] = math.floor(left / BIN_LENGTH) + 1.0
    corner[1] = math.floor(low / BIN_LENGTH) + 1.0
    corner[2] = math.floor((least + math.pi) / BIN_ANGLE) + 1.0
    return (
        math.floor(right / BIN_LENGTH) <= corner[0]
        and math.floor(high / BIN_LENGTH) <= corner[1]
        and math.floor((most + math.pi) / BIN_ANGLE) <= corner[2]
    )


@kernel(
    "int64(float64[:,::1], float64[::1], float64, int64[::1], float64[:,::1], int64[::1], float64[:,::1])"
)
def draw_until_enough(poses, weights, offset, fresh_index, fresh, limits, drawn):
    """Draw particles by weight until there are enough for the bins they fill (KLD sampling; Fox 2003, table 1).

    The k-th draw takes the particle at the fraction (offset + k * golden ratio) mod 1 of the cumulative weight: each
    draw is uniform where `offset` is, and any number of first draws is spread as evenly as in low-variance sampling
    (table 4.4), which could not stop early. A table of cut points (Chen and Asau 1974) finds each in constant time.

    Args:
        poses: Particles, shape (N, 3).
        weights: Shape (N,), not negative, sum above 0.
        offset: Uniform in [0, 1).
        fresh_index: Shape (M,): -1, or the row of `fresh` that is taken instead of a draw; empty where none is.
        fresh: Random poses, shape (F, 3).
        limits: Shape (M + 1,): how many particles k filled bins call for.
        drawn: Result, shape (M, 3).

    Returns:
        How many were drawn, at most M.
    """
    count = weights.shape[0]
    cumulative = np.empty(count)
    total = 0.0
    for i in range(count):
        total += weights[i]
        cumulative[i] = total
    first = np.empty(count, dtype=np.int64)
    i = 0
    for j in range(count):
        while i < count - 1 and cumulative[i] * count <= j * total:
            i += 1
        first[j] = i
    bins = 0
    corner, filled = np.empty(3), np.zeros(8, dtype=np.uint8)
    narrow = fresh_index.shape[0] == 0 and in_one_corner(poses, corner)  # at most eight bins, without a hash table
    places = 8
    while not narrow and places < 2 * drawn.shape[0]:
        places *= 2
    keys = np.full(places, -1, dtype=np.int64)
    for k in range(drawn.shape[0]):
        if not narrow and fresh_index.shape[0] > 0 and fresh_index[k] >= 0:
            source = fresh_index[k]
            drawn[k, 0], drawn[k, 1], drawn[k, 2] = fresh[source, 0], fresh[source, 1], fresh[source, 2]
        else:
            fraction = offset + k * FRACTION
            fraction -= math.floor(fraction)
            i = first[min(count - 1, int(fraction * count))]
            while i < count - 1 and cumulative[i] <= fraction * total:
                i += 1
            drawn[k, 0], drawn[k, 1], drawn[k, 2] = poses[i, 0], poses[i, 1], poses[i, 2]
        if narrow:
            right, upper = drawn[k, 0] / BIN_LENGTH >= corner[0], drawn[k, 1] / BIN_LENGTH >= corner[1]
            turned = (drawn[k, 2] + math.pi) / BIN_ANGLE >= corner[2]
            place = np.int64(right) + 2 * np.int64(upper) + 4 * np.int64(turned)
            bins += 1 - filled[place]
            filled[place] = 1
        else:
            key = key_of(drawn[k, 0], drawn[k, 1], drawn[k, 2])
            slot = slot_of(key, keys)
            if keys[slot] == -1:
                keys[slot] = key
                bins += 1
        if k + 1 >= limits[bins]:
            return k + 1
    return drawn.shape[0]


@kernel("int64(float64[:,::1], int64[::1])")
def label_clusters(poses, labels):
    """Label clusters of particles: bins that touch, also at corners and across the step from pi to -pi.

    Args:
        poses: Particles, shape (N, 3).
        labels: Result, shape (N,): 0, 1, …

    Returns:
        The number of clusters.
    """
    count = poses.shape[0]
    if in_one_corner(poses, np.empty(3)):
        labels[:] = 0
        return 1
    places = 8
    while places < 2 * count:
        places *= 2
    keys, labels_of_slots = np.full(places, -1, dtype=np.int64), np.full(places, -1, dtype=np.int64)
    slots = np.empty(count, dtype=np.int64)
    for i in range(count):
        key = key_of(poses[i, 0], poses[i, 1], poses[i, 2])
        slots[i] = slot_of(key, keys)
        keys[slots[i]] = key
    stack = np.empty(count, dtype=np.int64)
    clusters = 0
    for i in range(count):
        if labels_of_slots[slots[i]] == -1:
            labels_of_slots[slots[i]] = clusters
            stack[0] = slots[i]
            depth = 1
            while depth > 0:
                depth -= 1
                key = keys[stack[depth]]
                cell, sector = key >> 6, key & 63
                for dx in range(-1, 2):
                    for dy in range(-1, 2):
                        for da in range(-1, 2):
                            near = (cell + dx * (2 * OFFSET) + dy) * 64 + (sector + da + ANGLE_BINS) % ANGLE_BINS
                            slot = slot_of(near, keys)
                            if keys[slot] != -1 and labels_of_slots[slot] == -1:
                                labels_of_slots[slot] = clusters
                                stack[depth] = slot
                                depth += 1
            clusters += 1
        labels[i] = labels_of_slots[slots[i]]
    return clusters


@kernel("int64(float64[:,::1], boolean[::1], float64, float64[:,::1])")
def first_in_squares(points, counts, side, chosen):
    """Choose the first point in each square of a plane.

    Args:
        points: Shape (N, 2) in metres.
        counts: Bool of shape (N,): which points may be chosen; empty for all.
        side: Of a square (m).
        chosen: Result, shape (N, 2), of which the first rows are filled, in the points' order.

    Returns:
        How many were chosen.
    """
    found, places = 0, 8
    while places < 2 * points.shape[0]:
        places *= 2
    keys = np.full(places, -1, dtype=np.int64)
    for i in range(points.shape[0]):
        if counts.shape[0] > 0 and not counts[i]:
            continue
        column, row = int(math.floor(points[i, 0] / side)), int(math.floor(points[i, 1] / side))
        key = ((column + FARTHEST) << 32) + row + FARTHEST
        slot = slot_of(key, keys)
        if keys[slot] == -1:
            keys[slot] = key
            chosen[found, 0], chosen[found, 1] = points[i, 0], points[i, 1]
            found += 1
    return found
