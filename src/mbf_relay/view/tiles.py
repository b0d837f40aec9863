"""Grids in tiles: a browser gets every tile once, and then those that have changed.

A tile that changes gets the layer's next revision as its number. A browser gets the tiles with higher numbers than the
revision it has seen, oldest first. So a large map comes in portions, and a slow browser gets only the newest state of
each tile.
"""

from __future__ import annotations

import math
import zlib
from typing import NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.view.batch import part
from mbf_relay.view.layers import Taken, ViewLayer

TILE = 64
"""Cells along a tile's side: a moving obstacle changes about one tile, which compressed fits into a network packet."""
PORTION = 256
"""Largest number of tiles in one part, a megabyte of cells: about 10 ms of compression, which block the event loop."""


class GridShape(NamedTuple):
    """Size and pose of a grid.

    Attributes:
        width, height: Number of cells.
        resolution: Side of a cell (m).
        origin: Pose of the lower left corner in `frame`.
        frame: Name of its frame.
    """

    width: int
    height: int
    resolution: float
    origin: Pose2D
    frame: str


class TiledGrid(ViewLayer):
    """A layer with a grid; cells are -1 (unknown) or 0 to 100, sent as bytes with 255 for unknown."""

    def __init__(self, name: str, period: float) -> None:
        super().__init__(name, period)
        self._shape: Optional[GridShape] = None
        self._cells = np.zeros((0, 0), dtype=np.uint8)
        self._numbers = np.zeros((0, 0), dtype=np.int64)
        self._cache: Tuple[int, int, Optional[bytes], int] = (-1, -1, None, 0)

    @property
    def shape(self) -> Optional[GridShape]:
        """Size and pose of the grid, None before there is one."""
        return self._shape

    @property
    def cells(self) -> np.ndarray:
        """The cells as sent, shape (height, width)."""
        return self._cells

    def replace(self, shape: GridShape, values: np.ndarray) -> None:
        """Replace the grid; where size and pose are the same, only tiles that differ count as changed.

        Args:
            shape: Its size and pose.
            values: Cells row by row from the lower left, -1 to 100, shape (width * height,).

        Raises:
            ValueError: The number of values does not fit the size.
        """
        if shape.width < 1 or shape.height < 1 or len(values) != shape.width * shape.height:
            raise ValueError(f"grid of {shape.width} x {shape.height} cells with {len(values)} values")
        cells = np.asarray(values).astype(np.int8).view(np.uint8).reshape(shape.height, shape.width)
        if shape == self._shape:
            self._take(cells, 0, 0)
            return
        self._shape, self._cells = shape, cells.copy()
        rows, columns = math.ceil(shape.height / TILE), math.ceil(shape.width / TILE)
        self._numbers = self.revision + 1 + np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
        self.revision += rows * columns

    def update(self, column: int, row: int, width: int, values: np.ndarray) -> None:
        """Replace a window of the grid.

        Args:
            column, row: Its lower left cell.
            width: Its width in cells.
            values: Its cells row by row, shape (width * height,).

        Raises:
            ValueError: The window is not inside the grid, or there is no grid.
        """
        if width < 1 or len(values) == 0 or len(values) % width:
            raise ValueError(f"window {width} cells wide with {len(values)} values")
        cells = np.asarray(values).astype(np.int8).view(np.uint8).reshape(-1, width)
        height, whole_width = self._cells.shape
        if column < 0 or row < 0 or column + width > whole_width or row + len(cells) > height:
            raise ValueError(
                f"window at ({column}, {row}) of {width} x {len(cells)} cells in a grid of {whole_width} x {height}"
            )
        self._take(cells, column, row)

    def _take(self, cells: np.ndarray, column: int, row: int) -> None:
        """Write a window into the grid and number the tiles that it changes."""
        height, width = cells.shape
        for tile_row in range(row // TILE, (row + height - 1) // TILE + 1):
            top, bottom = max(row, tile_row * TILE), min(row + height, (tile_row + 1) * TILE)
            for tile_column in range(column // TILE, (column + width - 1) // TILE + 1):
                left, right = max(column, tile_column * TILE), min(column + width, (tile_column + 1) * TILE)
                old = self._cells[top:bottom, left:right]
                new = cells[top - row:bottom - row, left - column:right - column]
                if not np.array_equal(old, new):
                    old[:] = new
                    self.revision += 1
                    self._numbers[tile_row, tile_column] = self.revision

    def take(self, seen: int) -> Taken:
        """Return the tiles after revision `seen`, oldest first, PORTION at most; the last encoding is cached."""
        if self._shape is None or seen == self.revision:
            return None, seen
        if self._cache[:2] != (seen, self.revision):
            self._cache = (seen, self.revision, *self._encode(seen))
        return self._cache[2], self._cache[3]

    def _encode(self, seen: int) -> Taken:
        assert self._shape is not None
        flat = self._numbers.ravel()
        fresh = np.flatnonzero(flat > seen)
        fresh = fresh[np.argsort(flat[fresh], kind="stable")][:PORTION]
        columns = self._numbers.shape[1]
        blocks = []
        for index in fresh:
            row, column = (int(index) // columns) * TILE, (int(index) % columns) * TILE
            blocks.append(self._cells[row:row + TILE, column:column + TILE].tobytes())
        shape = self._shape
        header = {
            "layer": self.name, "width": shape.width, "height": shape.height, "resolution": shape.resolution,
            "origin": [round(value, 4) for value in shape.origin], "frame": shape.frame, "tile": TILE,
            "tiles": fresh.tolist(),
        }
        return part(header, zlib.compress(b"".join(blocks), 6)), int(flat[fresh[-1]])
