"""Measures of a world's difficulty: length of the shortest path, its detour, its narrowest passage, its clearance."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np
from scipy import ndimage

from mbf_relay.distances import distances_to_zeros

CELL = 0.15
"""Side (m) of a cell of generated walls, as in BARN's worlds."""
FINER = 3
"""Factor by which the grid for the shortest path is finer."""
FINEST = 1e-4
"""Precision (m) of the clearance of the widest path."""
STEPS = [(a, b, math.hypot(a, b)) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
"""Neighbours of a cell (rows, columns), and their distance in cells."""
ROBOT_RADIUS = 0.15
"""Circumscribed radius (m) of the robot, with which the shortest path is planned: it can turn in place everywhere."""


class Difficulty(NamedTuple):
    """Measures of a world, from start to goal.

    Attributes:
        path_length: Length (m) of the shortest path at the robot's width.
        path_length_ratio: That length divided by the distance from start to goal.
        narrowest_passage: Width (m) of the narrowest place of the widest path, the one that maximizes it.
        mean_clearance: Mean distance (m) to the nearest wall along the shortest path.
    """

    path_length: float
    path_length_ratio: float
    narrowest_passage: float
    mean_clearance: float


def difficulty_of(
    walls: np.ndarray, start: Tuple[float, ...], goal: Tuple[float, ...]
) -> Optional[Difficulty]:
    """Return the measures of a world; None where there is no path with ROBOT_RADIUS.

    Args:
        walls: Shape (rows, columns), bool, cells of CELL metres; paths do not leave the grid.
        start, goal: x, y in metres from the grid's lower left corner.
    """
    fine = np.kron(walls, np.ones((FINER, FINER), bool))
    side = CELL / FINER
    # distance between cell centres, less half a cell for the wall's own extent
    room = side * (_distances_to_walls(~fine) - 0.5)
    passable = room >= ROBOT_RADIUS
    ends = [tuple(int(value / side) for value in place[1::-1]) for place in (start, goal)]
    way = _shortest(passable, (ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]))
    if way is None:
        return None
    cells, length = way
    clearances = room[cells[:, 0], cells[:, 1]]
    straight = math.dist(start[:2], goal[:2])
    return Difficulty(
        length * side, max(1.0, length * side / straight), 2.0 * _widest(walls, start, goal),
        float(clearances.mean()),
    )


def _distances_to_walls(free: np.ndarray) -> np.ndarray:
    """Return each cell's distance (cells) to the nearest wall, limited to the grid's diagonal where there is none."""
    return np.minimum(distances_to_zeros(free), np.float32(math.hypot(*free.shape)))


def _widest(walls: np.ndarray, start: Tuple[float, ...], goal: Tuple[float, ...]) -> float:
    """Return the clearance (m) of the widest path from start to goal: the largest clearance kept all along a path.

    By bisection on a grid of half cells, whose nodes are the cells' corners, side centres and centres: the middle of a
    passage is such a node whatever its width, and so is the nearest point of a wall.

    Args:
        walls, start, goal: See `difficulty_of`.
    """
    rows, columns = walls.shape
    free = np.ones((2 * rows + 1, 2 * columns + 1), np.uint8)
    for row, column in np.ndindex(3, 3):
        free[row:row + 2 * rows:2, column:column + 2 * columns:2][walls] = 0
    room = 0.5 * CELL * _distances_to_walls(free)
    ends = [tuple(int(np.rint(2.0 * value / CELL)) for value in place[1::-1]) for place in (start, goal)]
    low, high = 0.0, float(min(room[end] for end in ends))
    while high - low > FINEST:
        middle = 0.5 * (low + high)
        regions, _ = ndimage.label(room >= middle, np.ones((3, 3)))
        joined = regions[ends[0]] == regions[ends[1]] != 0
        low, high = (middle, high) if joined else (low, middle)
    return low


def _shortest(
    passable: np.ndarray, start: Tuple[int, int], goal: Tuple[int, int]
) -> Optional[Tuple[np.ndarray, float]]:
    """Return the shortest path between two cells by A*: cells (N, 2) and length (cells); None where there is none."""
    rows, columns = passable.shape
    if not (passable[start] and passable[goal]):
        return None
    costs, before = {start: 0.0}, {start: start}
    waiting = [(math.dist(start, goal), start)]
    done = set()
    while waiting:
        _, cell = heapq.heappop(waiting)
        if cell == goal:
            way = [cell]
            while way[-1] != start:
                way.append(before[way[-1]])
            return np.array(way[::-1]), costs[goal]
        if cell in done:
            continue
        done.add(cell)
        for a, b, step in STEPS:
            following = (cell[0] + a, cell[1] + b)
            if not (0 <= following[0] < rows and 0 <= following[1] < columns and passable[following]):
                continue
            cost = costs[cell] + step
            if cost < costs.get(following, math.inf):
                costs[following], before[following] = cost, cell
                heapq.heappush(waiting, (cost + math.dist(following, goal), following))
    return None
