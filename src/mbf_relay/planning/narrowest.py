"""The bottleneck of the widest path: tells the user of a failed plan which gap is too narrow for the robot."""

from __future__ import annotations

import math
from typing import NamedTuple, Optional

import numpy as np

from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import Pose2D
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import reach_kernels

FITS = 254
"""Level of room, from 0 for an obstacle's cell, at which the robot fits."""


class NarrowPlace(NamedTuple):
    """A gap between obstacles.

    Attributes:
        x, y: Its middle (m), in the costmap's frame.
        width: Distance (m) between the obstacles.
        needed: The robot's width (m).
    """

    x: float
    y: float
    width: float
    needed: float

    def __str__(self) -> str:
        return (f"the narrowest place of the widest way, ({self.x:.2f}, {self.y:.2f}), is {self.width:.2f} m wide; "
                f"the robot needs {self.needed:.2f} m")


def narrowest_place(
    costmap: CostGrid, start: Pose2D, goal: Pose2D, through_unknown: bool, cancelled: Cancellation
) -> Optional[NarrowPlace]:
    """Return the narrowest place on the widest path; None where the robot fits through it, or there is no path at all.

    Cells are joined with their neighbours in the order of falling room; the cell that connects start and goal is the
    bottleneck. This is Kruskal's algorithm, and paths in its tree are the widest (Hu, "The maximum capacity route
    problem", 1961). Each cell is looked at once, so that it takes no longer than the search that failed before.

    Args:
        costmap: The snapshot.
        start, goal: On the grid, or a little outside. Free cells within half the robot's width of them count as wide
            enough, since the robot is there, or is to be.
        through_unknown: Whether unknown cells may be entered.
        cancelled: Ends the search; the result then is None.
    """
    grid = costmap.grid
    blocked = costmap.costs == LETHAL
    if not through_unknown:
        blocked |= costmap.costs == NO_INFORMATION
    enough = costmap.half_width / grid.resolution + 0.5  # from the centre of a cell to that of an obstacle's
    distances = distances_to_zeros(~blocked)
    room = (np.minimum(distances / enough, 1.0) * FITS).astype(np.uint8)
    ends = [grid.nearest_cell(pose.x, pose.y) for pose in (start, goal)]
    for column, row in ends:
        _widen(room, column, row, math.ceil(enough))
    order = np.argsort(FITS - room.ravel(), kind="stable")[: np.count_nonzero(room)]
    joint = reach_kernels.first_joint(
        room, order, *(row * grid.width + column for column, row in ends), cancelled.flag)
    if joint < 0:
        return None
    row, column = divmod(int(joint), grid.width)
    if room[row, column] >= FITS:
        return None
    width = gap_at(blocked, column, row, float(distances[row, column])) * grid.resolution
    if width >= costmap.width:
        return None
    return NarrowPlace(*grid.center_of(column, row), width, costmap.width)


def gap_at(blocked: np.ndarray, column: int, row: int, distance: float) -> float:
    """Return the width (cells) of the gap in which a cell lies.

    That is the distance between the obstacle nearest to the cell and those on the other side of it.

    Args:
        blocked: Shape (height, width), bool: True in obstacles' cells, of which there must be one.
        column, row: The cell.
        distance: Distance (cells) from its centre to that of the nearest obstacle's cell.
    """
    reach = math.ceil(distance) + 2  # the middle of a gap an even number of cells wide is half a cell aside
    top, left = max(0, row - reach), max(0, column - reach)
    around = np.argwhere(blocked[top:row + reach + 1, left:column + reach + 1]) - (row - top, column - left)
    nearest = around[np.argmin((around ** 2).sum(axis=1))]
    beyond = around[around @ nearest < 0]
    if len(beyond) == 0:
        return 2.0 * distance - 1.0
    apart = np.maximum(np.abs(beyond - nearest) - 1, 0)
    return float(np.hypot(apart[:, 0], apart[:, 1]).min())


def _widen(room: np.ndarray, column: int, row: int, reach: int) -> None:
    """Set `room` to FITS in the free cells within `reach` of a cell, and in the cell itself."""
    around = room[max(0, row - reach):row + reach + 1, max(0, column - reach):column + reach + 1]
    around[around > 0] = FITS
    room[row, column] = FITS
