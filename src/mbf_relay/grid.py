"""A 2-D grid: conversion between points and cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np


@dataclass(frozen=True)
class Grid:
    """An axis-aligned grid: cell (column, row) covers a square of `resolution` metres.

    Arrays over the grid have shape (height, width) and are indexed [row, column]; row 0 is the lowest y.

    Attributes:
        resolution: Side of a cell in metres, above zero.
        origin_x, origin_y: Position (m) of the lower left corner of cell (0, 0).
        width, height: Number of columns and rows.
    """

    resolution: float
    origin_x: float
    origin_y: float
    width: int
    height: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise ValueError(f"grid resolution is {self.resolution} m; it must be above 0")
        if self.width < 0 or self.height < 0:
            raise ValueError(f"grid size is {self.width} x {self.height} cells; it must not be negative")

    @property
    def shape(self) -> Tuple[int, int]:
        """Shape (height, width) of arrays over this grid."""
        return self.height, self.width

    def cell_at(self, x: float, y: float) -> Tuple[int, int]:
        """Return the (column, row) whose square holds the point; it may lie outside the grid."""
        return (
            math.floor((x - self.origin_x) / self.resolution),
            math.floor((y - self.origin_y) / self.resolution),
        )

    def nearest_cell(self, x: float, y: float) -> Tuple[int, int]:
        """Return the (column, row) of the grid whose square holds the point, or is nearest to one that lies outside."""
        column, row = self.cell_at(x, y)
        return min(max(column, 0), self.width - 1), min(max(row, 0), self.height - 1)

    def center_of(self, column: int, row: int) -> Tuple[float, float]:
        """Return the world position (m) of a cell's centre."""
        return (
            self.origin_x + (column + 0.5) * self.resolution,
            self.origin_y + (row + 0.5) * self.resolution,
        )

    def contains_cell(self, column: int, row: int) -> bool:
        """Return whether the cell is part of the grid."""
        return 0 <= column < self.width and 0 <= row < self.height

    def contains_point(self, x: float, y: float) -> bool:
        """Return whether the point (m) lies within the grid."""
        return math.isfinite(x) and math.isfinite(y) and self.contains_cell(*self.cell_at(x, y))

    def cells_at(self, points: np.ndarray) -> np.ndarray:
        """Return the (column, row) of each point: (N, 2) metres in, (N, 2) int64 out, unchecked against the bounds."""
        offsets = (np.asarray(points, dtype=float)[:, :2] - (self.origin_x, self.origin_y)) / self.resolution
        cells: np.ndarray = np.floor(offsets).astype(np.int64)
        return cells

    def centers_of(self, cells: np.ndarray) -> np.ndarray:
        """Return the world positions (m) of cell centres: (N, 2) columns and rows in, (N, 2) metres out."""
        return (np.asarray(cells)[:, :2] + 0.5) * self.resolution + (self.origin_x, self.origin_y)

    def contains_cells(self, cells: np.ndarray) -> np.ndarray:
        """Tell for each of (N, 2) columns and rows whether it is part of the grid."""
        cells = np.asarray(cells)
        return (cells[:, 0] >= 0) & (cells[:, 0] < self.width) & (cells[:, 1] >= 0) & (cells[:, 1] < self.height)
