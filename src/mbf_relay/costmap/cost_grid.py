"""What planners and controllers see of a costmap: one consistent snapshot of it."""

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
# default share of a cell: 0.01 m of 0.05 m, the footprint's default padding, which makes up for it
OBSTACLE_OVERLAP = 0.2


class Window(NamedTuple):
    """Columns x0 to x1 and rows y0 to y1 of a grid, the ends not included; empty where an end is not above its start.
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
        """Return the cells that a box lies on, by its lower left and upper right corner (m); some may be off the grid.
        """
        (x0, y0), (x1, y1) = grid.cell_at(*low), grid.cell_at(*high)
        return cls(x0, y0, x1 + 1, y1 + 1)

    @classmethod
    def around(cls, grid: Grid, x: float, y: float, reach: float) -> Window:
        """Return the cells that a square lies on whose sides are `reach` (m) away from a point; see `over`."""
        return cls.over(grid, (x - reach, y - reach), (x + reach, y + reach))

    @property
    def is_empty(self) -> bool:
        """Return whether no cell is in it."""
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
        """Return the part that lies in a grid; of one beside it nothing, and no end below 0, which would wrap."""
        return Window(max(self.x0, 0), max(self.y0, 0), max(min(self.x1, grid.width), 0),
                      max(min(self.y1, grid.height), 0))

    def shifted(self, columns: int, rows: int) -> Window:
        """Return the window moved by whole cells."""
        return Window(self.x0 + columns, self.y0 + rows, self.x1 + columns, self.y1 + rows)


EMPTY = Window(0, 0, 0, 0)


@dataclass(frozen=True)
class CostGrid:
    """A snapshot of a costmap; whoever holds it may rely on it not to change. Treat as read-only.

    Attributes:
        grid: Where the cells lie in `frame`.
        costs: Shape (height, width), uint8, C-contiguous: 0 free to 252, then INSCRIBED, LETHAL, NO_INFORMATION.
        frame: Frame of the grid ("map" or "odom").
        footprint: Outline of the robot around its base frame, shape (K, 2) in metres, padding included.
        inscribed_radius: Largest circle (m) around the base within the footprint.
        circumscribed_radius: Smallest circle (m) around the base that holds the footprint.
        revision: Grows with every change of `costs` and is never used twice, so that equal revisions are equal
            snapshots; 0 for a snapshot that no costmap made.
        stamp: Time (s) of the update it shows.
        history: The latest changes, oldest first: the revision each led to, and the cells it touched.
        obstacle_overlap: Share of a cell by which the footprint's outline may reach into an obstacle's cell.
        tracks: What moves, in `frame`; None where no layer looks for that.
        side_cost, turning_cost: Inflation's cost at half the robot's width, and at its circumscribed radius, from an
            obstacle: below the first its sides touch nothing, below the second no corner does however it turns.
            INSCRIBED where costs do not tell.
        sees_all_round: Whether sensors look in all directions at once; true where there are no tracks, as it is asked
            for their sake alone.
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
        """How far (m) the footprint reaches to the sides; the inscribed radius where a round robot has no corners."""
        return half_width_of(self.footprint, self.inscribed_radius)

    @cached_property
    def width(self) -> float:
        """The robot's width (m), a cell at least: what lengths that suit a robot are multiples of."""
        return max(2.0 * self.half_width, self.grid.resolution)

    def with_costs(self, costs: np.ndarray) -> CostGrid:
        """Return it with other costs, shape (height, width), of whose past nothing is known."""
        return replace(self, costs=costs, revision=0, history=())

    def blocks(self, poses: np.ndarray) -> np.ndarray:
        """Return at which poses, shape (N, 3), the robot's centre must not be: shape (N,), bool; nowhere off the grid.
        """
        cells = self.grid.cells_at(poses)
        inside = self.grid.contains_cells(cells)
        costs = np.zeros(len(poses), dtype=np.uint8)
        costs[inside] = self.costs[cells[inside, 1], cells[inside, 0]]
        blocked: np.ndarray = (costs == INSCRIBED) | (costs == LETHAL)
        return blocked

    def changed_since(self, revision: int) -> Optional[Window]:
        """Return a window that holds all that changed since an earlier snapshot, or None where that is not known."""
        changed = EMPTY
        for later, window in reversed(self.history):
            if later == revision:
                return changed
            changed = changed.union(window)
        return None


def without_tracks(costmap: CostGrid, now: float) -> CostGrid:
    """Return a snapshot without obstacles where tracks are at a time (s), give or take two cells: they will be gone."""
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
    """Return how far (m) an outline, shape (K, 2), reaches to the sides; the radius where a robot is round, K = 0."""
    return float(np.abs(footprint[:, 1]).max()) if len(footprint) else inscribed_radius
