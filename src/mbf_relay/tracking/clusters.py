"""Things in a scan: runs of neighbouring readings that a gap in depth sets off from what is round them."""

from __future__ import annotations

from typing import List, NamedTuple

import numpy as np

FEWEST = 3  # readings that make a thing
BEAMS_APART = 2  # readings that follow each other at this distance or nearer, in beams, may be of one thing
LEAST_RADIUS = 0.03  # m


class Rays(NamedTuple):
    """One scan, in a frame that stands still.

    Attributes:
        x, y: Where the sensor was (m).
        ends: Shape (N, 2): where its rays end (m), in the order of the beams.
        hits: Shape (N,), bool: whether anything was there.
        ranges, bearings: Shape (N,): metres, and radians in the frame.
    """

    x: float
    y: float
    ends: np.ndarray
    hits: np.ndarray
    ranges: np.ndarray
    bearings: np.ndarray


class Cluster(NamedTuple):
    """A thing in one scan, taken for a disc.

    Attributes:
        x, y, radius: Metres.
        is_whole: Whether nothing nearer stands before one of its edges.
        readings: Indices of its rays.
    """

    x: float
    y: float
    radius: float
    is_whole: bool
    readings: np.ndarray


def rays_of(x: float, y: float, ends: np.ndarray, hits: np.ndarray) -> Rays:
    """Return rays with their ranges and bearings; `ends` of shape (N, 2) and `hits` of shape (N,) as in Rays."""
    across, up = ends[:, 0] - x, ends[:, 1] - y
    return Rays(x, y, ends, hits, np.hypot(across, up), np.arctan2(up, across))


def find_clusters(rays: Rays, gap: float, largest: float) -> List[Cluster]:
    """Return the things in a scan that are small enough to be seen as a whole.

    Args:
        rays: The scan.
        gap: Distance (m) between neighbouring readings that parts two things, where the beams lie close.
        largest: Extent (m) above which it is a wall.
    """
    found = np.flatnonzero(rays.hits)
    if len(found) < FEWEST:
        return []
    count = len(rays.hits)
    ends, ranges = rays.ends[found], rays.ranges[found]
    after = np.roll(ends, -1, axis=0)
    beam = 2.0 * np.pi / count if count > 1 else 0.0
    turns = np.abs(np.diff(rays.bearings))
    beam = float(np.median(np.minimum(turns, 2.0 * np.pi - turns))) if len(turns) else beam
    apart = np.hypot(after[:, 0] - ends[:, 0], after[:, 1] - ends[:, 1])
    allowed = np.maximum(gap, 3.0 * beam * np.minimum(ranges, np.roll(ranges, -1)))
    skipped = (np.roll(found, -1) - found) % count
    breaks = np.flatnonzero((apart > allowed) | (skipped > BEAMS_APART))
    if len(breaks) == 0:
        return []
    order = np.roll(np.arange(len(found)), -(int(breaks[0]) + 1))
    pieces = np.split(order, np.cumsum(np.diff(np.append(breaks, breaks[0] + len(found))))[:-1])
    result = []
    for piece in pieces:
        if len(piece) >= FEWEST:
            size = ends[piece].max(axis=0) - ends[piece].min(axis=0)
            if float(np.hypot(*size)) <= largest:
                result.append(_cluster(rays, found[piece], gap, largest))
    return result


def _cluster(rays: Rays, readings: np.ndarray, gap: float, largest: float) -> Cluster:
    """Return the disc whose near side the readings lie on: as wide as seen, its centre where they put it on the mean.
    """
    ends, ranges, bearings = rays.ends[readings], rays.ranges[readings], rays.bearings[readings]
    first, last = ends[0] - (rays.x, rays.y), ends[-1] - (rays.x, rays.y)
    radius = min(0.5 * largest, max(LEAST_RADIUS, 0.5 * float(np.hypot(*(ends[-1] - ends[0])))))
    ahead = first / max(float(np.hypot(*first)), 1e-6) + last / max(float(np.hypot(*last)), 1e-6)
    middle = float(np.arctan2(ahead[1], ahead[0]))
    aside = ranges * np.sin(bearings - middle)
    depth = float(
        np.mean(ranges * np.cos(bearings - middle) + np.sqrt(np.maximum(0.0, radius * radius - aside * aside)))
    )
    return Cluster(
        rays.x + depth * float(np.cos(middle)), rays.y + depth * float(np.sin(middle)), radius,
        not (_hides(rays, readings[0], -1, gap) or _hides(rays, readings[-1], 1, gap)), readings,
    )


def part(cluster: Cluster, rays: Rays, discs: np.ndarray, gap: float) -> List[Cluster]:
    """Return the things a cluster is of, where several are to be expected there: each reading is of the nearest one.

    Things that pass close by each other, one before the other, are one run of readings.

    Args:
        cluster: One of the scan's.
        rays: The scan.
        discs: Shape (K, 3): x, y and radius (m) of the things expected.
        gap: Distance (m) from the edge of a thing within which a reading may be of it.
    """
    readings = cluster.readings
    near = np.hypot(discs[:, 0] - cluster.x, discs[:, 1] - cluster.y) < cluster.radius + discs[:, 2] + gap
    if near.sum() < 2 or len(readings) < 2 * FEWEST:
        return [cluster]
    x, y, radii = discs[near].T
    ends = rays.ends[readings]
    off = np.abs(np.hypot(ends[:, :1] - x, ends[:, 1:] - y) - radii)
    nearest = off.argmin(axis=1)
    there = [disc for disc in range(len(x)) if np.count_nonzero(off[nearest == disc, disc] < gap) >= FEWEST]
    if len(there) < 2:
        return [cluster]
    nearest = off[:, there].argmin(axis=1)
    pieces = [readings[nearest == disc] for disc in range(len(there))]
    return [_cluster(rays, piece, gap, 2.0 * cluster.radius)._replace(is_whole=False) for piece in pieces]


def _hides(rays: Rays, edge: int, step: int, gap: float) -> bool:
    """Return whether what the next beam beyond an edge sees stands before it, so that more of it may lie behind."""
    beside = (int(edge) + step) % len(rays.hits)
    return bool(rays.hits[beside] and rays.ranges[beside] < rays.ranges[edge] - gap)
