"""A rectangle of cells: what changed, what is to be done again, what is sent."""

from __future__ import annotations

from typing import NamedTuple, Tuple

from mbf_relay.grid import Grid


class Window(NamedTuple):
    """Columns x0 to x1 and rows y0 to y1 of a grid, the ends not included; empty where an end is not above its start."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def of(cls, grid: Grid) -> Window:
        """Return the window that holds a whole grid."""
        return cls(0, 0, grid.width, grid.height)

    @property
    def is_empty(self) -> bool:
        """Tell whether no cell is in it."""
        return self.x1 <= self.x0 or self.y1 <= self.y0

    @property
    def slices(self) -> Tuple[slice, slice]:
        """Index of the window in an array over the grid."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)

    def union(self, other: Window) -> Window:
        """Return the smallest window that holds both."""
        if self.is_empty:
            return other
        if other.is_empty:
            return self
        return Window(min(self.x0, other.x0), min(self.y0, other.y0), max(self.x1, other.x1), max(self.y1, other.y1))

    def grown(self, cells: int) -> Window:
        """Return the window widened on all sides; an empty one stays empty."""
        return self if self.is_empty else Window(self.x0 - cells, self.y0 - cells, self.x1 + cells, self.y1 + cells)

    def within(self, grid: Grid) -> Window:
        """Return the part that lies in a grid."""
        return Window(max(self.x0, 0), max(self.y0, 0), min(self.x1, grid.width), min(self.y1, grid.height))

    def shifted(self, columns: int, rows: int) -> Window:
        """Return the window moved by whole cells."""
        return Window(self.x0 + columns, self.y0 + rows, self.x1 + columns, self.y1 + rows)


EMPTY = Window(0, 0, 0, 0)
