"""The snapshot of a costmap that planners and controllers work on, and windows of its cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.grid import Grid
from mbf_relay.tracking.track import Track

FREE_SPACE = 0
INSCRIBED = 253  # with the robot's centre here, its inscribed circle touches an obstacle
LETHAL = 254
NO_INFORMATION = 255
OBSTACLE_OVERLAP = 0.2
"""Default of obstacle_overlap, a share of a cell: 0.01 m of 0.05 m, as much as the default footprint_padding adds."""


class Window(NamedTuple):
    """The cells of a grid in columns x0 to x1 and rows y0 to y1, x1 and y1 excluded; empty where x1 <= x0 or y1 <= y0.
    """

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def of(cls, grid: Grid) -> Window:
        """Return the window that holds a whole grid."""
        return cls(0, 0, grid.width, grid.height)

    @classmethod
    def over(cls, grid: Grid, low: Sequence[float], high: Sequence[float]) -> Window:
        """Return the cells that a box overlaps, given its lower left and upper right corner (m); not cut to the grid.
        """
        (x0, y0), (x1, y1) = grid.cell_at(*low), grid.cell_at(*high)
        return cls(x0, y0, x1 + 1, y1 + 1)

    @classmethod
    def around(cls, grid: Grid, x: float, y: float, reach: float) -> Window:
        """Return the cells that a square of side 2 `reach` (m) around a point overlaps; not cut to the grid."""
        return cls.over(grid, (x - reach, y - reach), (x + reach, y + reach))

    @property
    def is_empty(self) -> bool:
        """Whether it holds no cell."""
        return self.x1 <= self.x0 or self.y1 <= self.y0

    @property
    def slices(self) -> Tuple[slice, slice]:
        """Slices (rows, columns) that take the window out of an array over the grid; it must lie within the grid."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)

    def union(self, other: Window) -> Window:
        """Return the smallest window that holds both."""
        if self.is_empty:
            return other
        if other.is_empty:
            return self
        return Window(min(self.x0, other.x0), min(self.y0, other.y0), max(self.x1, other.x1), max(self.y1, other.y1))

    def grown(self, cells: int) -> Window:
        """Return the window widened by so many cells on all sides; an empty one stays empty."""
        return self if self.is_empty else Window(self.x0 - cells, self.y0 - cells, self.x1 + cells, self.y1 + cells)

    def within(self, grid: Grid) -> Window:
        """Return the part within a grid, empty where there is none. No bound is negative: slices would wrap."""
        return Window(max(self.x0, 0), max(self.y0, 0), max(min(self.x1, grid.width), 0),
                      max(min(self.y1, grid.height), 0))

    def shifted(self, columns: int, rows: int) -> Window:
        """Return the window moved by whole cells."""
        return Window(self.x0 + columns, self.y0 + rows, self.x1 + columns, self.y1 + rows)


EMPTY = Window(0, 0, 0, 0)
"""A window without cells."""


@dataclass(frozen=True)
class CostGrid:
    """A snapshot of a costmap, which later updates do not change. Treat as read-only.

    Attributes:
        grid: Where the cells lie in `frame`.
        costs: Shape (height, width), uint8, C-contiguous: 0 free to 252, then INSCRIBED, LETHAL, NO_INFORMATION.
        frame: Frame of the grid ("map" or "odom").
        footprint: Outline of the robot around its base frame, shape (K, 2) in metres, padding included.
        inscribed_radius: Radius (m) of the largest circle around the base frame's origin within the footprint.
        circumscribed_radius: Radius (m) of the smallest circle around that origin that holds the footprint.
        revision: Number that grows with every change of `costs`, unique in the process: snapshots of equal revisions
            have equal costs. 0 for a snapshot that was not taken from a Costmap.
        stamp: Time (s) of the costmap's last update; 0 before the first.
        history: The latest changes, oldest first: the revision each led to, and the cells it touched.
        obstacle_overlap: Share of a cell by which the footprint's outline may reach into an obstacle's cell.
        tracks: Moving obstacles, in `frame`; None where no layer tracks any.
        side_cost, turning_cost: Inflation's cost at half the robot's width, and at its circumscribed radius, from an
            obstacle. Where the cost under the base is below the first, its sides touch nothing; below the second it
            can turn on the spot. INSCRIBED where no layer inflates.
        sees_all_round: Whether the sensors cover all directions at once. Only users of `tracks` ask: true where there
            are none.
    """

    grid: Grid
    costs: np.ndarray
    frame: str
    footprint: np.ndarray
    inscribed_radius: float
    circumscribed_radius: float
    revision: int = 0
    stamp: float = 0.0
    history: Tuple[Tuple[int, Window], ...] = ()
    obstacle_overlap: float = OBSTACLE_OVERLAP
    tracks: Optional[Tuple[Track, ...]] = None
    side_cost: int = INSCRIBED
    turning_cost: int = INSCRIBED
    sees_all_round: bool = True

    @cached_property
    def half_width(self) -> float:
        """Distance (m) to which the footprint reaches to the left or right; see `half_width_of`."""
        return half_width_of(self.footprint, self.inscribed_radius)

    @cached_property
    def width(self) -> float:
        """The robot's width (m), at least one cell; lengths that should scale with the robot are multiples of it."""
        return max(2.0 * self.half_width, self.grid.resolution)

    def with_costs(self, costs: np.ndarray) -> CostGrid:
        """Return a copy with other costs, shape (height, width), without revision and history."""
        return replace(self, costs=costs, revision=0, history=())

    def blocks(self, poses: np.ndarray) -> np.ndarray:
        """Return which poses, shape (N, 3), lie on an INSCRIBED or LETHAL cell: shape (N,), bool; False off the grid.
        """
        cells = self.grid.cells_at(poses)
        inside = self.grid.contains_cells(cells)
        costs = np.zeros(len(poses), dtype=np.uint8)
        costs[inside] = self.costs[cells[inside, 1], cells[inside, 0]]
        blocked: np.ndarray = (costs == INSCRIBED) | (costs == LETHAL)
        return blocked

    def changed_since(self, revision: int) -> Optional[Window]:
        """Return a window that holds every change since an earlier snapshot; None where that is too long ago to tell.

        Args:
            revision: The earlier snapshot's.
        """
        changed = EMPTY
        for later, window in reversed(self.history):
            if later == revision:
                return changed
            changed = changed.union(window)
        return None


def without_tracks(costmap: CostGrid, now: float) -> CostGrid:
    """Return a snapshot in which lethal cells of moving obstacles are free, for what asks about a later time.

    These are the lethal cells within a track's radius and two cells of where it is predicted at time `now` (s); costs
    inflated around them stay.
    """
    grid, costs = costmap.grid, costmap.costs.copy()
    for track in costmap.tracks or ():
        there = track.at(now)
        reach = there.radius + 2.0 * grid.resolution
        window = Window.around(grid, there.x, there.y, reach).within(grid)
        if window.is_empty:
            continue
        across = grid.origin_x + (np.arange(window.x0, window.x1) + 0.5) * grid.resolution - there.x
        up = grid.origin_y + (np.arange(window.y0, window.y1)[:, None] + 0.5) * grid.resolution - there.y
        part = costs[window.slices]
        part[(np.hypot(across, up) <= reach) & (part == LETHAL)] = FREE_SPACE
    return costmap.with_costs(costs)


def half_width_of(footprint: np.ndarray, inscribed_radius: float) -> float:
    """Return the largest |y| (m) of an outline, shape (K, 2), in the base frame; the radius where K is 0."""
    return float(np.abs(footprint[:, 1]).max()) if len(footprint) else inscribed_radius
