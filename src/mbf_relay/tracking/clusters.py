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


class Clusters(NamedTuple):
    """The things in one scan, taken for discs.

    Attributes:
        discs: Shape (K, 4): x, y and radius in metres; 1 where nothing nearer stands before one of the edges, else 0.
        runs: Shape (K, 2): where the readings of each begin and end in `order`.
        order: Indices of rays.
    """

    discs: np.ndarray
    runs: np.ndarray
    order: np.ndarray

    def readings(self, index: int) -> np.ndarray:
        """Return the indices of the rays that hit one of the things."""
        begin, end = self.runs[index]
        return self.order[begin:end]


def rays_of(x: float, y: float, ends: np.ndarray, hits: np.ndarray) -> Rays:
    """Return rays with their ranges and bearings; `ends` of shape (N, 2) and `hits` of shape (N,) as in Rays."""
    across, up = ends[:, 0] - x, ends[:, 1] - y
    return Rays(x, y, ends, hits, np.hypot(across, up), np.arctan2(up, across))


def find_clusters(rays: Rays, gap: float, largest: float) -> Clusters:
    """Return the things in a scan that are small enough to be seen as a whole.

    Args:
        rays: The scan.
        gap: Distance (m) between neighbouring readings that parts two things, where the beams lie close.
        largest: Extent (m) above which it is a wall.
    """
    count = len(rays.hits)
    discs, runs, order = np.empty((count, 4)), np.empty((count, 2), np.int64), np.empty(count, np.int64)
    things = cluster_kernels.find_things(*_scan(rays), gap, largest, discs, runs, order)
    return Clusters(discs[:things], runs[:things], order)


def _scan(rays: Rays) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float, float]:
    """Return a scan as kernels take it."""
    return rays.ends, rays.hits, rays.ranges, rays.bearings, rays.x, rays.y


def part_clusters(found: Clusters, rays: Rays, expected: np.ndarray, moving: np.ndarray, gap: float) -> Clusters:
    """Return clusters with those parted that are of several things, near something that moves.

    Args:
        found: Of the scan.
        rays: The scan.
        expected: Shape (N, 3): x, y and radius (m) of the things that may be there.
        moving: Shape (N,), bool: which of them move.
        gap: Distance (m) from the edge of a thing within which a reading may be of it.
    """
    movers, discs, readings = expected[moving], [], []
    for index, disc in enumerate(found.discs):
        near = np.hypot(movers[:, 0] - disc[0], movers[:, 1] - disc[1]) < disc[2] + movers[:, 2] + gap
        pieces = _part(disc, found.readings(index), rays, expected, gap) if near.any() else []
        for piece in pieces or [found.readings(index)]:
            discs.append(_disc_of(rays, piece, gap, 2.0 * disc[2]) if pieces else disc)
            readings.append(piece)
    ends = np.cumsum([len(piece) for piece in readings], dtype=np.int64)
    runs = np.column_stack((np.append(0, ends[:-1]), ends)) if readings else np.zeros((0, 2), np.int64)
    return Clusters(
        np.array(discs).reshape(-1, 4), np.ascontiguousarray(runs), np.concatenate([found.order[:0], *readings]))


def _part(disc: np.ndarray, readings: np.ndarray, rays: Rays, expected: np.ndarray, gap: float) -> List[np.ndarray]:
    """Return the readings of the things a cluster is of, where several are expected there; empty where it is one.

    Each reading is of the nearest. Things that pass close by each other, one before the other, are one run of readings.

    Args:
        disc: Shape (4,): the cluster; see Clusters.
        readings: Its rays.
        rays, expected, gap: As for `part_clusters`.
    """
    near = np.hypot(expected[:, 0] - disc[0], expected[:, 1] - disc[1]) < disc[2] + expected[:, 2] + gap
    if near.sum() < 2 or len(readings) < 2 * FEWEST:
        return []
    x, y, radii = expected[near].T
    ends = rays.ends[readings]
    off = np.abs(np.hypot(ends[:, :1] - x, ends[:, 1:] - y) - radii)
    nearest = off.argmin(axis=1)
    there = [each for each in range(len(x)) if np.count_nonzero(off[nearest == each, each] < gap) >= FEWEST]
    if len(there) < 2:
        return []
    nearest = off[:, there].argmin(axis=1)
    return [readings[nearest == each] for each in range(len(there))]


def _disc_of(rays: Rays, readings: np.ndarray, gap: float, largest: float) -> np.ndarray:
    """Return the disc of a part of a cluster, of which never the whole is seen."""
    disc = np.empty(4)
    cluster_kernels.measure(*_scan(rays), readings, gap, largest, disc)
    disc[3] = 0.0
    return disc
