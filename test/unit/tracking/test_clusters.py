"""Clusters: the compiled loops against the plain way, on random scans."""

import math

import numpy as np
import pytest
from made_scans import scan

from mbf_relay.tracking.cluster_kernels import _BEAMS_APART, _LEAST_RADIUS, FEWEST
from mbf_relay.tracking.clusters import find_clusters, part_clusters, rays_of


def plain_clusters(rays, gap, largest):
    """Return x, y, radius, is_whole and readings of the things in a scan."""
    found, count = np.flatnonzero(rays.hits), len(rays.hits)
    if len(found) < FEWEST:
        return []
    ends, ranges = rays.ends[found], rays.ranges[found]
    turns = np.abs(np.diff(rays.bearings))
    beam = np.median(np.minimum(turns, 2.0 * math.pi - turns))
    apart = np.hypot(*(np.roll(ends, -1, axis=0) - ends).T)
    allowed = np.maximum(gap, 3.0 * beam * np.minimum(ranges, np.roll(ranges, -1)))
    breaks = np.flatnonzero((apart > allowed) | ((np.roll(found, -1) - found) % count > _BEAMS_APART))
    if len(breaks) == 0:
        return []
    order = np.roll(np.arange(len(found)), -(breaks[0] + 1))
    pieces = np.split(order, np.cumsum(np.diff(np.append(breaks, breaks[0] + len(found))))[:-1])
    return [plain_cluster(rays, found[piece], gap, largest) for piece in pieces
            if len(piece) >= FEWEST and np.hypot(*np.ptp(ends[piece], axis=0)) <= largest]


def plain_cluster(rays, readings, gap, largest):
    ends, ranges = rays.ends[readings], rays.ranges[readings]
    first, last = ends[0] - (rays.x, rays.y), ends[-1] - (rays.x, rays.y)
    radius = min(0.5 * largest, max(_LEAST_RADIUS, 0.5 * np.hypot(*(ends[-1] - ends[0]))))
    ahead = first / max(np.hypot(*first), 1e-6) + last / max(np.hypot(*last), 1e-6)
    off = rays.bearings[readings] - np.arctan2(ahead[1], ahead[0])
    aside = ranges * np.sin(off)
    depth = np.mean(ranges * np.cos(off) + np.sqrt(np.maximum(0.0, radius ** 2 - aside ** 2)))
    center = (rays.x, rays.y) + depth * ahead / np.hypot(*ahead)
    is_hidden = False
    for edge, step in ((readings[0], -1), (readings[-1], 1)):
        beside = (edge + step) % len(rays.hits)
        is_hidden |= bool(rays.hits[beside] and rays.ranges[beside] < rays.ranges[edge] - gap)
    return *center, radius, not is_hidden, readings


@pytest.mark.parametrize("seed", range(40))
def test_things_are_those_of_the_plain_way(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.choice([3, 5, 40, 360]))
    x, y = rng.uniform(-3.0, 3.0, 2)
    angles = rng.uniform(-3.0, 3.0) + np.arange(count) * rng.choice([2.0, 1.0]) * math.pi / count
    ranges = np.repeat(rng.uniform(0.15, 3.5, count), rng.integers(1, 12, count))[:count] + rng.normal(0, 0.01, count)
    hits = rng.random(count) < rng.choice([0.3, 0.9, 1.0])
    rays = rays_of(x, y, np.column_stack((x + ranges * np.cos(angles), y + ranges * np.sin(angles))), hits)
    found, plain = find_clusters(rays, 0.1, 0.8), plain_clusters(rays, 0.1, 0.8)
    assert [list(found.readings(index)) for index in range(len(found.runs))] == [list(each) for *_, each in plain]
    for disc, (center_x, center_y, radius, is_whole, _) in zip(found.discs, plain):
        assert disc[:3] == pytest.approx((center_x, center_y, radius), abs=1e-9)
        assert disc[3] == is_whole


def two_in_one():
    """Return a scan of two discs side by side, in which they are one cluster, that cluster, and another beside it."""
    rays = rays_of(0.0, 0.0, *scan(0.0, 0.0, [*PAIR, (-1.0, 0.5, 0.15)], Still()))
    found = find_clusters(rays, 0.1, 0.8)
    assert len(found.discs) == 2
    return rays, found


class Still:
    """A generator without noise."""

    def normal(self, mean, deviation, count):
        return np.full(count, mean)


PAIR = [(1.0, -0.07, 0.1), (1.0, 0.075, 0.1)]


@pytest.mark.parametrize("expected, moving, is_parted", [
    (PAIR, [True, False], True),
    (PAIR, [False, True], True),
    (PAIR[::-1], [True, True], True),
    (PAIR, [False, False], False),  # nothing moves there
    (PAIR[:1], [True], False),  # one alone is expected
    ([*PAIR, (-1.0, -2.0, 0.1)], [False, False, True], False),  # what moves is elsewhere
    ([*PAIR, (1.0, 0.0, 0.1)], [True, True, True], True),  # no reading is of the one between them
    ([(1.4, -0.07, 0.1), (1.4, 0.075, 0.1)], [True, True], False),  # they are expected behind it
])
def test_a_cluster_is_parted_where_several_are_expected_and_one_of_them_moves(expected, moving, is_parted):
    rays, found = two_in_one()
    parted = part_clusters(found, rays, np.array(expected), np.array(moving), 0.1)
    assert len(parted.discs) == len(parted.runs) == 2 + is_parted
    before, after = (
        sorted(ray for index in range(len(each.discs)) for ray in each.readings(index)) for each in (found, parted))
    assert before == after
    whole = [disc.tolist() for disc in parted.discs if disc[3] > 0.0]
    assert whole == [disc.tolist() for disc in found.discs if disc[0] < 0.0 or not is_parted]
    if is_parted:
        pieces = sorted((disc.tolist() for disc in parted.discs if disc[0] > 0.0), key=lambda disc: disc[1])
        for (x, y, radius, _), (there_x, there_y, there_radius) in zip(pieces, PAIR):
            assert math.hypot(x - there_x, y - there_y) < 0.04 and abs(radius - there_radius) < 0.04
        for index, disc in enumerate(parted.discs):
            ends = rays.ends[parted.readings(index)]
            assert np.abs(np.hypot(*(ends - disc[:2]).T) - disc[2]).max() < 0.07


@pytest.mark.parametrize("off, is_parted", [(-0.01, True), (0.01, False)])
@pytest.mark.parametrize("across, up", [(0.0, 1.0), (0.6, -0.8), (-1.0, 0.0)])
def test_a_cluster_is_parted_where_what_moves_is_nearer_than_a_gap(off, is_parted, across, up):
    rays, found = two_in_one()
    x, y, radius, _ = found.discs[np.argmax(found.discs[:, 0])]
    away = radius + 0.2 + 0.1 + off
    expected = np.array([*PAIR, (x + away * across, y + away * up, 0.2)])
    parted = part_clusters(found, rays, expected, np.array([False, False, True]), 0.1)
    assert len(parted.discs) == 2 + is_parted


def test_nothing_is_parted_in_an_empty_scan():
    rays = rays_of(0.0, 0.0, np.zeros((0, 2)), np.zeros(0, bool))
    parted = part_clusters(find_clusters(rays, 0.1, 0.8), rays, np.array(PAIR), np.array([True, True]), 0.1)
    assert parted.discs.shape == (0, 4) and parted.runs.shape == (0, 2) and len(parted.order) == 0


@pytest.mark.parametrize("count", [3, 90])
def test_a_robot_in_a_tube_takes_its_wall_for_nothing_that_moves(count):
    """All round it no reading is far from the next: there is no place where a segment begins."""
    bearings = np.linspace(-np.pi, np.pi, count, endpoint=False)
    ends = 0.3 * np.column_stack((np.cos(bearings), np.sin(bearings)))
    assert len(find_clusters(rays_of(0.0, 0.0, ends, np.ones(count, bool)), 0.6, 0.8).discs) == 0
