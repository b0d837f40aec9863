"""Objects in a scan: segments of neighbouring readings that are separated by jumps in range from what is around them.
"""

from __future__ import annotations

from typing import List, NamedTuple, Tuple

import numpy as np

from mbf_relay.tracking import cluster_kernels
from mbf_relay.tracking.cluster_kernels import FEWEST


class Rays(NamedTuple):
    """One scan, in a fixed frame.

    Attributes:
        x, y: Position of the sensor (m).
        ends: End points of its rays (m), in the order of the beams, shape (N, 2).
        hits: Whether each ray hit something, shape (N,), bool.
        ranges, bearings: Ranges (m), and directions (rad) in the frame, shape (N,).
    """

    x: float
    y: float
    ends: np.ndarray
    hits: np.ndarray
    ranges: np.ndarray
    bearings: np.ndarray


class Clusters(NamedTuple):
    """The objects in one scan, approximated by discs.

    Attributes:
        discs: x, y and radius (m), and 0 where an edge is occluded, else 1; shape (K, 4).
        runs: Begin and end of each object's readings in `order`, shape (K, 2).
        order: Indices of rays, object by object.
    """

    discs: np.ndarray
    runs: np.ndarray
    order: np.ndarray

    def readings(self, index: int) -> np.ndarray:
        """Return the indices of the rays that hit an object, given by its index."""
        begin, end = self.runs[index]
        return self.order[begin:end]


def rays_of(x: float, y: float, ends: np.ndarray, hits: np.ndarray) -> Rays:
    """Return a scan with ranges and bearings computed; arguments as in Rays."""
    across, up = ends[:, 0] - x, ends[:, 1] - y
    return Rays(x, y, ends, hits, np.hypot(across, up), np.arctan2(up, across))


def find_clusters(rays: Rays, gap: float, largest: float) -> Clusters:
    """Return the objects in a scan up to a size.

    Args:
        rays: The scan.
        gap: Distance (m) between neighbouring readings that separates two objects; more where beams are far apart.
        largest: Extent (m) above which a segment is a wall.
    """
    count = len(rays.hits)
    discs, runs, order = np.empty((count, 4)), np.empty((count, 2), np.int64), np.empty(count, np.int64)
    things = cluster_kernels.find_things(*_scan(rays), gap, largest, discs, runs, order)
    return Clusters(discs[:things], runs[:things], order)


def _scan(rays: Rays) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float, float]:
    """Return a scan as arguments of kernels."""
    return rays.ends, rays.hits, rays.ranges, rays.bearings, rays.x, rays.y


def part_clusters(found: Clusters, rays: Rays, expected: np.ndarray, moving: np.ndarray, gap: float) -> Clusters:
    """Return the clusters, with those near moving objects split that contain several expected objects.

    Args:
        found: The clusters of the scan.
        rays: The scan.
        expected: x, y and radius (m) of the objects that may be there, shape (N, 3).
        moving: Which of them move, shape (N,), bool.
        gap: Distance (m) from an object's edge within which a reading may belong to it.
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
    """Split a cluster's readings among the objects expected there; empty where it is only one.

    Each reading belongs to the nearest object. Objects that pass close to each other are one segment of readings.

    Args:
        disc: The cluster, shape (4,); see Clusters.
        readings: Indices of its rays.
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
    """Return the disc of a part of a cluster, which always counts as occluded."""
    disc = np.empty(4)
    cluster_kernels.measure(*_scan(rays), readings, gap, largest, disc)
    disc[3] = 0.0
    return disc
