"""Random worlds by seed: obstacle fields, offices, corridors, mazes and crowds, as entries of a worlds file.

Each kind draws a grid of walls and movers from a random generator. A world without a path at the robot's width is drawn
again, so that every world returned can be solved.
"""

from __future__ import annotations

import math
from typing import Any, Callable, Dict, List, NamedTuple, Tuple

import numpy as np
from scipy import ndimage

from mbf_relay.simulation.difficulty import CELL, Difficulty, difficulty_of

HEIGHT = 0.5
"""Height (m) of walls, above the lidar's at about 0.2 m."""
MOST_DRAWS = 1000
"""Draws of one world after which an error is raised."""
TIME_PER_METRE = 12.0
"""Time limit (s) per metre of the shortest path, which is two fifths of a burger's top speed."""

Walls = np.ndarray
"""Shape (rows, columns), bool."""


class Drawn(NamedTuple):
    """A world as drawn.

    Attributes:
        walls: Shape (rows, columns), bool, cells of CELL metres; row 0 has the lowest y.
        start, goal: x, y (m) and yaw (rad), from the grid's lower left corner.
        movers: Entries as in a worlds file.
    """

    walls: Walls
    start: Tuple[float, float, float]
    goal: Tuple[float, float, float]
    movers: List[Dict[str, Any]]


def barn_like(rng: np.random.Generator) -> Drawn:
    """Draw a field of obstacles by a cellular automaton, as Perille et al. (SSRR 2020) describe for BARN.

    Cells are filled at random, then smoothed: one fills with five filled neighbours or more and empties with one or
    none. The robot crosses from below to above.
    """
    columns, rows, edge = 30, 40, 8
    field = rng.random((rows, columns)) < rng.uniform(0.10, 0.30)
    for _ in range(int(rng.integers(2, 5))):
        neighbours = ndimage.convolve(field.astype(int), np.ones((3, 3), int), mode="constant") - field
        field = (field | (neighbours >= 5)) & (neighbours > 1)
    walls = np.zeros((rows + 2 * edge, columns), bool)
    walls[edge:-edge] = field
    walls[:, [0, -1]] = True
    middle = columns * CELL / 2.0
    return Drawn(
        walls, (middle, 0.5 * edge * CELL, math.pi / 2), (middle, (rows + 1.5 * edge) * CELL, math.pi / 2), []
    )


def office(rng: np.random.Generator) -> Drawn:
    """Draw rooms on both sides of a corridor, each with a door and a desk; start and goal are in different rooms."""
    size, hall, count = 14, 6, int(rng.integers(2, 5))
    walls = _walled(2 * size + hall + 4, count * (size + 1) + 1)
    sides = ((size + 1, 1), (size + hall + 2, size + hall + 3))  # row of the wall, first row of the room
    for wall, first in sides:
        walls[wall] = True
        for room in range(count):
            left = room * (size + 1)
            walls[first:first + size, left] = True
            door = left + 2 + int(rng.integers(0, size - 7))
            walls[wall, door:door + 6] = False
            row, column = first + int(rng.integers(4, size - 5)), left + int(rng.integers(5, size - 4))
            walls[row:row + 2, column:column + 4] = True
    rooms = rng.permutation(count)
    places = [(first + (2 if first == 1 else size - 2), int(room) * (size + 1) + 3)
              for (_, first), room in zip(sides, (rooms[0], rooms[-1]))]
    return Drawn(walls, _place(places[0]), _place(places[1]), [])


def corridor(rng: np.random.Generator) -> Drawn:
    """Draw a corridor with turns and varying width."""
    turns = int(rng.integers(2, 6))
    walls = np.ones((14 + 16 * turns, 60), bool)
    row, column = 7, 8
    start = (row, column)
    for _ in range(turns):
        half = int(rng.integers(2, 5))
        target = int(rng.integers(8, 52))
        low, high = sorted((column, target))
        walls[row - half:row + half + 1, low - half:high + half + 1] = False
        half = int(rng.integers(2, 5))
        walls[row - half:row + 16 + half + 1, target - half:target + half + 1] = False
        row, column = row + 16, target
    return Drawn(walls, _place(start), _place((row, column)), [])


def maze(rng: np.random.Generator) -> Drawn:
    """Draw a maze by randomized depth-first search, with exactly one path between any two places."""
    rooms, size = int(rng.integers(3, 6)), 8
    walls = np.ones((rooms * size + 1, rooms * size + 1), bool)
    way, seen = [(0, 0)], {(0, 0)}
    _clear(walls, (0, 0), (0, 0), size)
    while way:
        row, column = way[-1]
        free = [(row + a, column + b) for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        free = [(a, b) for a, b in free if 0 <= a < rooms and 0 <= b < rooms and (a, b) not in seen]
        if not free:
            way.pop()
            continue
        following = free[int(rng.integers(len(free)))]
        _clear(walls, (row, column), following, size)
        seen.add(following)
        way.append(following)
    last = rooms * size - size // 2
    return Drawn(walls, _place((size // 2, size // 2)), _place((last, last)), [])


def crowd(rng: np.random.Generator) -> Drawn:
    """Draw a hall in which people walk back and forth across the robot's path, each at its own speed."""
    walls = _walled(60, 40)
    width, length = 40 * CELL, 60 * CELL
    movers = []
    for index in range(int(rng.integers(2, 7))):
        y = float(rng.uniform(1.8, length - 1.8))
        ends = sorted(float(value) for value in (rng.uniform(0.6, 1.6), rng.uniform(width - 1.6, width - 0.6)))
        if rng.random() < 0.5:
            ends.reverse()
        period = abs(ends[1] - ends[0]) / float(rng.uniform(0.15, 0.6))
        movers.append({
            "name": f"walker_{index}", "radius": 0.2, "height": 1.7,
            "waypoints": [[0.0, ends[0], y], [period, ends[1], y], [2.0 * period, ends[0], y]],
        })
    return Drawn(walls, (width / 2.0, 0.6, math.pi / 2), (width / 2.0, length - 0.6, math.pi / 2), movers)


KINDS: Dict[str, Callable[[np.random.Generator], Drawn]] = {
    "barn": barn_like, "office": office, "corridor": corridor, "maze": maze, "crowd": crowd,
}
"""Generators by name."""


def generate(kind: str, seed: int) -> Dict[str, Any]:
    """Return a world as an entry of a worlds file, with measures under `difficulty` (see Difficulty).

    Args:
        kind: One of KINDS.
        seed: Equal seeds give equal worlds.

    Raises:
        ValueError: There is no such kind, or no world that can be solved was found within MOST_DRAWS.
    """
    if kind not in KINDS:
        raise ValueError(f"there are no worlds of kind '{kind}'; there are {', '.join(KINDS)}")
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    for _ in range(MOST_DRAWS):
        drawn = KINDS[kind](rng)
        measured = difficulty_of(drawn.walls, drawn.start[:2], drawn.goal[:2])
        if measured is not None:
            return _entry(f"{kind}_{seed:04d}", drawn, measured)
    raise ValueError(f"no world of kind '{kind}' and seed {seed} has a way through")


def _entry(name: str, drawn: Drawn, measured: Difficulty) -> Dict[str, Any]:
    return {
        "name": name, "start": _rounded(drawn.start), "goal": _rounded(drawn.goal), "goal_radius": 0.3,
        "reference_path_length": round(measured.path_length, 3),
        "time_limit": round(10.0 + TIME_PER_METRE * measured.path_length, 1),
        "boxes": [_box(*rectangle) for rectangle in _rectangles(drawn.walls)], "movers": drawn.movers,
        "difficulty": {key: round(value, 3) for key, value in {
            **measured._asdict(), "movers": float(len(drawn.movers)),
        }.items()},
    }


def _rectangles(walls: Walls) -> List[Tuple[int, int, int, int]]:
    """Return rectangles (row, column, rows, columns) that cover the walls without overlap: runs of rows, grown upward.
    """
    left, found = walls.copy(), []
    for row in range(len(left)):
        column = 0
        while column < left.shape[1]:
            if not left[row, column]:
                column += 1
                continue
            end = column
            while end < left.shape[1] and left[row, end]:
                end += 1
            top = row + 1
            while top < len(left) and left[top, column:end].all():
                top += 1
            left[row:top, column:end] = False
            found.append((row, column, top - row, end - column))
            column = end
    return found


def _box(row: int, column: int, rows: int, columns: int) -> List[float]:
    center = ((column + 0.5 * columns) * CELL, (row + 0.5 * rows) * CELL)
    return _rounded((*center, 0.0, columns * CELL, rows * CELL, HEIGHT))


def _walled(rows: int, columns: int) -> Walls:
    walls = np.zeros((rows, columns), bool)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    return walls


def _clear(walls: Walls, one: Tuple[int, int], other: Tuple[int, int], size: int) -> None:
    (top, left), (bottom, right) = (tuple(f(a, b) * size for a, b in zip(one, other)) for f in (min, max))
    walls[top + 1:bottom + size, left + 1:right + size] = False


def _place(cell: Tuple[int, int]) -> Tuple[float, float, float]:
    return (cell[1] + 0.5) * CELL, (cell[0] + 0.5) * CELL, 0.0


def _rounded(values: Tuple[float, ...]) -> List[float]:
    return [round(float(value), 4) for value in values]
