"""The tracker's compiled loops against the same with whole arrays, on random things: equal to the last bit."""

import math

import numpy as np
import pytest

from mbf_relay.tracking import tracker_kernels as kernels
from mbf_relay.tracking.tracker_kernels import BELIEF, COLUMNS, CONVINCED, RADIUS, SEEN, VELOCITY

GATE, SURPRISE, DEPTH, ASIDE, MOST, HALF_HIDDEN = 9.0, 3.0, 0.08, 0.05, 5, 0.2
ELAPSED = 0.2
SEEDS = pytest.mark.parametrize("seed", range(30))


def random_things(rng, count):
    things = np.zeros((count, COLUMNS))
    things[:, :4] = rng.normal(0.0, (1.0, 1.0, 0.1, 0.1), (count, 4))
    things[:, 4:7] = rng.uniform(1e-4, 0.02, (count, 3))
    things[:, RADIUS], things[:, BELIEF] = rng.uniform(0.03, 0.3, count), rng.integers(0, MOST + 1, count)
    return things


def random_discs(rng, things, count):
    centers = np.vstack((things[:, :2], rng.normal(0.0, 1.0, (count, 2))))[rng.permutation(len(things) + count)[:count]]
    is_whole = rng.random(count) < 0.7
    discs = np.column_stack((centers + rng.normal(0.0, 0.05, (count, 2)), rng.uniform(0.03, 0.3, count), is_whole))
    return discs, np.where(is_whole, 0.025 ** 2, 0.1 ** 2)


def plain_association(things, discs, noises):
    """Return for each cluster the thing it is, -1 for none."""
    taken = np.full(len(discs), -1)
    off = things[:, None, :2] - discs[:, :2]
    squares, totals = (off ** 2).sum(axis=2), things[:, 4][:, None] + noises
    distances = (squares / totals).ravel()
    turned = np.where(things[:, BELIEF] >= CONVINCED, 2.0 * ELAPSED * np.hypot(things[:, 2], things[:, 3]), 0.0)
    is_near = (distances <= GATE) | (squares <= (turned[:, None] + np.sqrt(GATE * totals)) ** 2).ravel()
    pairs = is_near.nonzero()[0]
    free = [True] * len(things)
    for pair in pairs[np.argsort(distances[pairs], kind="stable")].tolist():
        thing, cluster = divmod(pair, len(discs))
        if free[thing] and taken[cluster] < 0:
            taken[cluster], free[thing] = thing, False
    return taken


@SEEDS
def test_things_move_on_as_the_filter_says(seed):
    rng = np.random.default_rng(seed)
    things, elapsed, q = random_things(rng, 7), rng.uniform(0.05, 0.5), 0.3 ** 2
    position, cross, velocity = things[:, 4:7].T.copy()
    expected = things.copy()
    expected[:, :2] += elapsed * expected[:, 2:4]
    expected[:, 4] = position + 2.0 * elapsed * cross + elapsed ** 2 * velocity + 0.25 * q * elapsed ** 4
    expected[:, 5] = cross + elapsed * velocity + 0.5 * q * elapsed ** 3
    expected[:, 6] = velocity + q * elapsed ** 2
    kernels.predict(things, elapsed, elapsed ** 2, 0.25 * q * elapsed ** 4, 0.5 * q * elapsed ** 3, q * elapsed ** 2)
    assert (things == expected).all()


@SEEDS
def test_clusters_are_the_things_nearest_to_them_and_put_them_where_the_filter_does(seed):
    rng = np.random.default_rng(seed)
    things = random_things(rng, rng.integers(0, 30))
    if seed % 3 == 0:
        things[:, :2] *= 0.1  # many pairs
    discs, noises = random_discs(rng, things, rng.integers(0, 30))
    taken = np.empty(len(discs), np.int64)
    kernels.associate(things, discs, noises, ELAPSED, taken)
    assert taken.tolist() == plain_association(things, discs, noises).tolist()

    expected, known = things.copy(), (taken >= 0).nonzero()[0]
    which, noise = taken[known], noises[known]
    position, cross, velocity = things[which, 4:7].T
    total, off = position + noise, discs[known, :2] - things[which, :2]
    surprises = (things[which, BELIEF] >= CONVINCED) & ((off ** 2).sum(axis=1) > SURPRISE * total)
    turned = np.where(surprises, (things[which, 2:4] ** 2).sum(axis=1), 0.0)
    position, cross, velocity = position + ELAPSED * ELAPSED * turned, cross + ELAPSED * turned, velocity + turned
    total = position + noise
    expected[which, :2] += (position / total)[:, None] * off
    expected[which, 2:4] += (cross / total)[:, None] * off
    expected[which, 4] = position - position * position / total
    expected[which, 5] = cross - position * cross / total
    expected[which, 6] = velocity - cross * cross / total
    expected[which, SEEN] = 7.5
    radii, seen = expected[which, RADIUS], discs[known, 2]
    expected[which, RADIUS] = np.where(discs[known, 3] > 0.0, radii + 0.3 * (seen - radii), np.maximum(radii, seen))
    kernels.correct(things, discs, noises, taken, 7.5, ELAPSED)
    assert (things == expected).all()


def random_scan(rng, count):
    """Return where a scan was taken, its bearings and its ranges."""
    return rng.normal(0.0, 0.2, 2), rng.uniform(-math.pi, math.pi, count), rng.uniform(0.3, 3.0, count)


def plain_sees_past(place, bearings, ranges, ends):
    order = np.argsort(bearings, kind="stable")
    directions, depths = bearings[order], ranges[order]
    least = np.minimum(depths, np.minimum(np.roll(depths, 1), np.roll(depths, -1)))
    across, up = (ends - place).T
    there, distances = np.arctan2(up, across), np.hypot(across, up)
    index = np.searchsorted(directions, there) % len(order)
    turns = np.abs(directions - there[:, None])
    turns = np.minimum(turns, 2.0 * np.pi - turns)
    sees = turns[np.arange(len(ends)), index] < 0.1
    with np.errstate(invalid="ignore"):
        beside = turns <= np.arcsin(ASIDE / distances)[:, None]
    beside[np.arange(len(ends)), index] = True
    past = (least > distances[:, None] + DEPTH) | ~beside
    return sees & (distances > ASIDE) & past.all(axis=1)


def arranged(place, bearings, ranges):
    directions, depths = np.empty(len(ranges)), np.empty(len(ranges))
    kernels.arrange(bearings, ranges, np.argsort(bearings, kind="stable"), directions, depths)
    return (*place.tolist(), directions, depths)


@SEEDS
def test_a_thing_moves_that_is_fast_and_came_to_where_nothing_was(seed):
    rng = np.random.default_rng(seed)
    things = random_things(rng, 12)
    discs, _ = random_discs(rng, things, 12)
    taken = np.where(rng.random(12) < 0.8, rng.permutation(12), -1)
    ends, lengths = rng.normal(0.0, 1.0, (60, 2)), rng.integers(3, 6, 12)
    order, stops = rng.permutation(60), np.cumsum(lengths)
    runs = np.column_stack((stops - lengths, stops))
    scans = [random_scan(rng, rng.choice([0, 1, 90, 360])) for _ in range(2)]

    was_empty = np.zeros(60, dtype=bool)
    for scan in scans:
        was_empty |= plain_sees_past(*scan, ends) if len(scan[2]) else False
    expected, moves = things.copy(), np.zeros(60, dtype=bool)
    for (first, last), disc, which in zip(runs, discs, taken):
        thing = expected[which]
        if which < 0:
            continue
        is_fast = np.hypot(thing[2], thing[3]) >= np.maximum(0.04, np.sqrt(thing[VELOCITY]))
        is_known, readings = thing[BELIEF] >= CONVINCED, order[first:last]
        came = is_known or np.count_nonzero(was_empty[readings]) / len(readings) >= 0.25
        against = -HALF_HIDDEN if is_known and not disc[3] else -1.0
        thing[BELIEF] = min(MOST, max(0.0, thing[BELIEF] + (1.0 if is_fast and came else against)))
        moves[readings] |= thing[BELIEF] >= CONVINCED

    was_free, moving = np.zeros((2, 60), dtype=bool)
    for scan in scans:
        kernels.mark_free(*arranged(*scan), ends, was_free)
    kernels.update_beliefs(things, discs, taken, runs, order, was_free, 0.04, moving)
    assert (was_free == was_empty).all() and (things == expected).all() and (moving == moves).all()
