"""Ray casting at the fixed surface, for the lidar."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.simulation.shapes import bounds, subdivided
from mbf_relay.simulation.surface_kernels import cast

SMALLEST_CELL, LARGEST_CELL = 0.05, 0.25
"""Least and largest side (m) of a grid cell; within, it depends on the density of triangles."""
PER_CELL = 4.0
"""Wanted number of triangles per cell: more slow down the tests in a cell, fewer mean more cells along a ray."""
MOST_CELLS = 1000000
"""Largest number of cells, which take 8 bytes each: in huge worlds cells become larger than LARGEST_CELL."""
LONGEST_EDGE = 1.0
"""Longest edge (m) of a triangle: triangles are entered in all cells of their bounding box, crossed or not."""
MARGIN = 1e-6
"""Margin (m) of the bounding boxes, so that rays along the border of two cells hit."""


class Surface:
    """Triangles in a grid seen from above; a nearly horizontal ray tests only those in the cells that it crosses."""

    def __init__(self, triangles: np.ndarray) -> None:
        """Build the grid for triangles, shape (N, 3, 3) in metres."""
        triangles = subdivided(triangles, LONGEST_EDGE)
        edges = triangles[:, 1:] - triangles[:, :1]
        self._triangles = np.ascontiguousarray(np.concatenate((triangles[:, :1], edges), axis=1).reshape(-1, 9))
        lowest, highest = bounds(triangles[:, :, :2])
        lower, upper = lowest - MARGIN, highest + MARGIN
        corner = lower.min(axis=0, initial=math.inf) if len(triangles) else np.zeros(2)
        extent = upper.max(axis=0) - corner if len(triangles) else np.zeros(2)
        side = _side_of_cells(float(extent[0]), float(extent[1]), len(triangles))
        self._columns, self._rows = (int(count) + 1 for count in extent / side)
        self._frame = np.array([corner[0], corner[1], side])
        low, high = ((place - corner) // side for place in (lower, upper))
        self._sort(low.astype(np.int64), high.astype(np.int64))

    def _sort(self, low: np.ndarray, high: np.ndarray) -> None:
        """Build the lists of triangles by cell, from (column, row) of bounding boxes' corners, shape (N, 2) each."""
        widths, heights = (high - low + 1).T
        owners = np.repeat(np.arange(len(low)), widths * heights)
        before = np.concatenate(([0], np.cumsum(widths * heights)[:-1])) if len(low) else np.zeros(0, dtype=np.int64)
        inside = np.arange(len(owners)) - before[owners]
        columns = low[owners, 0] + inside % widths[owners]
        rows = low[owners, 1] + inside // widths[owners]
        cells = rows * self._columns + columns
        order = np.argsort(cells, kind="stable")
        self._members = np.ascontiguousarray(owners[order], dtype=np.int64)
        counts = np.bincount(cells, minlength=self._columns * self._rows)
        self._first = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)

    def cast(self, start: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Cast rays from `start`, shape (3,), to `ends`, shape (B, 3), in metres.

        Returns:
            Fraction of each ray before its first hit, 1 where it hits nothing, shape (B,).
        """
        shares = np.empty(len(ends))
        cast(
            start, np.ascontiguousarray(ends), self._triangles, self._first, self._members, self._frame, self._columns,
            self._rows, shares,
        )
        return shares


def _side_of_cells(width: float, height: float, triangles: int) -> float:
    """Return the side (m) of the cells for an area of `width` x `height` metres with a number of triangles."""
    fitting = math.sqrt(PER_CELL * width * height / max(1, triangles))
    fewest = max(math.sqrt(width * height / MOST_CELLS), max(width, height) / MOST_CELLS)
    return max(min(LARGEST_CELL, max(SMALLEST_CELL, fitting)), fewest)
