"""Clusters: the compiled loops against the plain way, on random scans."""

import math

import numpy as np
import pytest

from mbf_relay.tracking.cluster_kernels import _BEAMS_APART, _LEAST_RADIUS, FEWEST
from mbf_relay.tracking.clusters import find_clusters, rays_of


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
