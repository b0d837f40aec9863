"""One-scan global localization: all the places on a map where one scan fits about as well as anywhere.

Branch and bound over a pyramid of the map (Olson 2015; Hess et al. 2016): a block of poses is left out where even the
best score around each beam's end cannot reach the best place found. Nothing is left to chance, so the one place that
fits is found whatever the map's size, and where several look alike all of them are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbf_relay.localization.distance_field import DistanceField, is_free
from mbf_relay.localization.scan_likelihood import apart, thin_out
from mbf_relay.localization.search_kernels import best_first, bound_all, descend

BEAMS = 60
"""Ends of beams that are searched with, at most; evenly chosen, as more take longer and tell little more."""
FEWEST_BEAMS = 5
"""Beams with a return below which no place is told: so few fit almost anywhere."""
TURNS = 180
"""Headings tried, 2 degrees apart: at 10 m a beam's end moves by 0.35 m, about the width of a score (see SIGMA)."""
SIGMA = 0.15
"""Standard deviation (m) of a beam's end from the map's nearest obstacle; coarse, as the climb afterwards is finer."""
PLACE = 0.1
"""Side (m) of the smallest blocks, about, each of which gives one place."""
TOP = 0.8
"""Side (m) of the blocks the search begins with; each may give one place for each heading."""
MOST_VISITS = 3_000_000
"""Blocks examined, in some seconds, after which the search ends with the places found so far."""
MARGIN = 0.1
"""How far below the best a place's score, 0 to 1, may be for it still to be returned."""


class Places(NamedTuple):
    """Where a scan fits, best first.

    Attributes:
        poses: Shape (K, 3).
        scores: Shape (K,), 0 to 1.
        searched: Share, 0 to 1, of what may hold such places that was looked at before the search ended.
    """

    poses: np.ndarray
    scores: np.ndarray
    searched: float = 1.0


class ScanSearch:
    """Finds scans on one map."""

    def __init__(self, field: DistanceField) -> None:
        self._field = field
        sigma = max(SIGMA, field.resolution)
        scores = (255.0 * np.exp(np.square(field.face_distances) * np.float32(-0.5 / sigma ** 2))).astype(np.uint8)
        self._leaf = max(0, round(math.log2(PLACE / field.resolution)))
        self._top = max(self._leaf + 1, round(math.log2(TOP / field.resolution)))
        best, open_cells = scores[field.codes], is_free(field.occupancy.data).view(np.uint8)
        shapes = [best.shape]
        for _ in range(self._top):
            shapes.append(((shapes[-1][0] + 1) // 2, (shapes[-1][1] + 1) // 2))
        ends = np.cumsum([(height + 1) * (width + 1) for height, width in shapes])
        self._levels = np.column_stack((np.concatenate(([0], ends[:-1])), shapes)).astype(np.int64)
        self._scores, self._free = np.zeros(ends[-1], dtype=np.uint8), np.zeros(ends[-1], dtype=np.uint8)
        for level in range(self._top + 1):
            fits, reachable = self._level(self._scores, level), self._level(self._free, level)
            fits[:-1, :-1], reachable[1:, 1:] = best, open_cells
            best, open_cells = _halved(best), _halved(open_cells)
            np.maximum(fits[1:], fits[:-1], out=fits[1:])
            np.maximum(fits[:, 1:], fits[:, :-1], out=fits[:, 1:])

    def _level(self, pyramid: np.ndarray, level: int) -> np.ndarray:
        """Return a level, with the row and the column of blocks before its first, as a view of the pyramid."""
        begin, height, width = self._levels[level]
        return pyramid[begin:begin + (height + 1) * (width + 1)].reshape(height + 1, width + 1)

    def search(self, hits: np.ndarray, most: int = 200, margin: float = MARGIN) -> Places:
        """Return the places where a scan fits best, none within 0.3 m and 0.15 rad of a better one.

        Args:
            hits: Ends of the beams that came back, shape (B, 2), in the base's frame.
            most: How many places to return.
            margin: How far below the best a place's score, 0 to 1, may be.
        """
        endpoints = thin_out(hits, BEAMS)
        blocks = self._blocks()
        if len(endpoints) < FEWEST_BEAMS or len(blocks) == 0:
            return Places(np.empty((0, 3)), np.empty(0))
        headings = np.arange(TURNS) * (2.0 * math.pi / TURNS)
        offsets = self._offsets(endpoints, headings)
        bounds = np.empty(len(blocks) * TURNS, dtype=np.uint16)
        bound_all(self._top, blocks, offsets, self._scores, self._levels, bounds)
        full = 255.0 * len(endpoints)
        order = np.empty(min(len(bounds), MOST_VISITS + 1), dtype=np.int64)  # each takes a visit at least
        best_first(bounds, order)
        found = np.empty((len(order), 4))
        count, looked = descend(
            self._leaf,
            self._top,
            blocks,
            bounds,
            order,
            offsets,
            self._scores,
            self._levels,
            self._free,
            margin * full,
            MOST_VISITS,
            found,
        )
        found = found[:count]
        least = found[:, 0].max(initial=0.0) - margin * full
        found = found[found[:, 0] >= least]
        side = self._field.resolution * 2 ** self._leaf
        poses = np.column_stack((
            (found[:, 2] + 0.5) * side, (found[:, 1] + 0.5) * side, headings[found[:, 3].astype(np.int64)],
        ))
        poses = self._field.origin.transform_poses(poses)
        kept = apart(poses, found[:, 0], most, distance=0.3, turn=0.15) if count else []
        searched = 1.0 if looked < 0 else looked / np.count_nonzero(bounds >= least)
        return Places(poses[kept], found[kept, 0] / full, searched)

    def _blocks(self) -> np.ndarray:
        """Return row and column of the blocks to begin with, shape (R, 2)."""
        return np.ascontiguousarray(np.argwhere(self._level(self._free, self._top)[1:, 1:]))

    def _offsets(self, endpoints: np.ndarray, headings: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(headings)[:, None], np.sin(headings)[:, None]
        columns = cos * endpoints[:, 0] - sin * endpoints[:, 1]
        rows = sin * endpoints[:, 0] + cos * endpoints[:, 1]
        return np.ascontiguousarray(
            np.rint(np.stack((columns, rows), axis=2) / self._field.resolution).astype(np.int32)
        )


def _halved(values: np.ndarray) -> np.ndarray:
    """Return the highest of every 2 x 2 cells; an odd last row or column stands alone."""
    height, width = values.shape
    highest = np.zeros(((height + 1) // 2, (width + 1) // 2), dtype=values.dtype)
    for part in (values[::2, ::2], values[1::2, ::2], values[::2, 1::2], values[1::2, 1::2]):
        place = highest[:part.shape[0], :part.shape[1]]
        np.maximum(place, part, out=place)
    return highest
