"""What never moves, as the lidar sees it."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.simulation.shapes import bounds, subdivided
from mbf_relay.simulation.surface_kernels import cast

SMALLEST_CELL, LARGEST_CELL = 0.05, 0.25
"""Sides (m) of the cells that triangles are sorted into: small where they are many."""
PER_CELL = 4.0
"""Triangles in a cell that are as quick to look through as the cells on the way are to walk."""
MOST_CELLS = 1000000
LONGEST_EDGE = 1.0
"""Of a triangle (m): what lies aslant of the cells would be in many that it does not cross."""
MARGIN = 1e-6
"""By how much (m) a triangle reaches into the cells around, so that rays along a border of cells meet it."""


class Surface:
    """Triangles sorted into square cells seen from above; nearly level rays look into the few cells on their way."""

    def __init__(self, triangles: np.ndarray) -> None:
        """Sort triangles, shape (N, 3, 3) in metres."""
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
        """Note which triangles reach into each cell, given the (column, row) of their corners, shape (N, 2) each."""
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
            Shape (B,): the share of its way each ray went before it hit something, 1 where it hit nothing.
        """
        shares = np.empty(len(ends))
        cast(
            start, np.ascontiguousarray(ends), self._triangles, self._first, self._members, self._frame, self._columns,
            self._rows, shares,
        )
        return shares


def _side_of_cells(width: float, height: float, triangles: int) -> float:
    """Return the side (m) of the cells for an area of `width` x `height` metres with so many triangles in it."""
    fitting = math.sqrt(PER_CELL * width * height / max(1, triangles))
    fewest = max(math.sqrt(width * height / MOST_CELLS), max(width, height) / MOST_CELLS)
    return max(min(LARGEST_CELL, max(SMALLEST_CELL, fitting)), fewest)
