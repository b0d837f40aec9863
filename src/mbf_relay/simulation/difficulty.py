"""How hard a world is: length and crookedness of the way through, its narrowest passage, and the room beside it."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np
from scipy import ndimage

from mbf_relay.distances import distances_to_zeros

CELL = 0.15
"""Side (m) of a cell of generated walls, as in BARN's worlds: a burger is a cell and a half wide."""
FINER = 3
"""Cells of the measured grid in one of the walls' each way."""
FINEST = 1e-4
"""Metres to which the room beside the widest way is measured."""
STEPS = [(a, b, math.hypot(a, b)) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
ROBOT_RADIUS = 0.15
"""Metres from the robot's turning point to its farthest corner: it turns in place wherever the way leads."""


class Difficulty(NamedTuple):
    """Measures of a way.

    Attributes:
        path_length: Of the shortest way at the robot's width (m).
        path_length_ratio: The same by the straight line's length.
        narrowest_passage: Width (m) of the narrowest place on the widest way.
        mean_clearance: Distance (m) to the nearest wall, mean along the shortest way.
    """

    path_length: float
    path_length_ratio: float
    narrowest_passage: float
    mean_clearance: float


def difficulty_of(
    walls: np.ndarray, start: Tuple[float, ...], goal: Tuple[float, ...]
) -> Optional[Difficulty]:
    """Return the measures of the shortest way that a robot turning in place fits through; None where there is none.

    Args:
        walls: Shape (rows, columns), bool, cells of CELL metres; beyond the grid is free and not entered.
        start, goal: x, y in metres from the grid's lower left corner.
    """
    fine = np.kron(walls, np.ones((FINER, FINER), bool))
    side = CELL / FINER
    # From the centre of a cell to that of the nearest wall's; the wall begins half a cell before.
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
    """Return the distance (cells) from each cell to the nearest that is not free, at most the grid's diagonal."""
    return np.minimum(distances_to_zeros(free), np.float32(math.hypot(*free.shape)))


def _widest(walls: np.ndarray, start: Tuple[float, ...], goal: Tuple[float, ...]) -> float:
    """Return the largest room (m) that some way between two places keeps to all along.

    Looked at are corners, middles of sides and middles of cells: the middle of a passage is there, however many cells
    wide it is, and what is nearest in the walls, too.

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
    """Return cells (N, 2) and length (cells) of the shortest way between two cells, by A*; None where there is none."""
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
