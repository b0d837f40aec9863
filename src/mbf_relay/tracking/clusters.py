"""Things in a scan: runs of neighbouring readings that a gap in depth sets off from what is round them."""

from __future__ import annotations

from typing import List, NamedTuple, Tuple

import numpy as np

from mbf_relay.tracking import cluster_kernels
from mbf_relay.tracking.cluster_kernels import FEWEST


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
    count = len(rays.hits)
    if count < FEWEST:
        return []
    beam = _usual_turn(rays.bearings)
    discs, runs, order = np.empty((count, 4)), np.empty((count, 2), np.int64), np.empty(count, np.int64)
    things = cluster_kernels.find_things(*_scan(rays), beam, gap, largest, discs, runs, order)
    return [
        Cluster(x, y, radius, is_whole > 0.0, order[begin:end])
        for (x, y, radius, is_whole), (begin, end) in zip(discs[:things].tolist(), runs[:things].tolist())
    ]


def _usual_turn(bearings: np.ndarray) -> float:
    """Return the median angle (rad) from one bearing to the next, of two or more; np.median takes ten times as long."""
    turns = np.abs(bearings[1:] - bearings[:-1])
    turns = np.minimum(turns, 2.0 * np.pi - turns)
    middle = len(turns) // 2
    if len(turns) % 2:
        turns.partition(middle)
        return float(turns[middle])
    turns.partition((middle - 1, middle))
    return 0.5 * float(turns[middle - 1] + turns[middle])


def _cluster(rays: Rays, readings: np.ndarray, gap: float, largest: float) -> Cluster:
    disc = np.empty(4)
    cluster_kernels.measure(*_scan(rays), readings, gap, largest, disc)
    x, y, radius, is_whole = disc.tolist()
    return Cluster(x, y, radius, is_whole > 0.0, readings)


def _scan(rays: Rays) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float, float]:
    """Return a scan as kernels take it."""
    return rays.ends, rays.hits, rays.ranges, rays.bearings, rays.x, rays.y


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
