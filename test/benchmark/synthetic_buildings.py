"""Made buildings: floors of several kinds, each different for every generator handed in."""

from __future__ import annotations

from typing import Callable, Dict

import numpy as np

RESOLUTION = 0.05


def office(rng: np.random.Generator) -> np.ndarray:
    """Return a floor with a corridor, rooms on both sides and furniture in them: bool, shape (400, 640)."""
    walls = shell(400, 640)
    walls[178:181], walls[219:222] = True, True
    for left in np.arange(0, 600, 80):
        walls[:180, left:left + 3] = walls[220:, left:left + 3] = True
        for low, high in ((178, 181), (219, 222)):
            door = left + rng.integers(10, 50)
            walls[low:high, door:door + 20] = False
    scatter_boxes(walls, 60, 6, 24, rng)
    walls[184:216, 4:-4] = False
    return walls


def corridors(rng: np.random.Generator) -> np.ndarray:
    """Return bare corridors around a block, with a niche here and there: bool, shape (500, 800)."""
    walls = np.ones((500, 800), dtype=bool)
    for band in ((slice(20, 64), slice(20, 780)), (slice(436, 480), slice(20, 780)), (slice(230, 272), slice(20, 780))):
        walls[band] = False
    for band in ((slice(20, 480), slice(20, 66)), (slice(20, 480), slice(734, 780)), (slice(20, 480), slice(380, 424))):
        walls[band] = False
    for _ in range(40):
        column, row = rng.integers(60, 720), (20, 64, 230, 272, 436, 480)[rng.integers(6)]
        depth = rng.integers(3, 12)
        walls[row - depth:row + depth, column:column + rng.integers(16, 40)] = False
    return walls


def hall(rng: np.random.Generator) -> np.ndarray:
    """Return a cluttered hall with pillars: bool, shape (480, 560)."""
    walls = shell(480, 560)
    for row in range(90, 440, 90):
        for column in range(90, 520, 110):
            walls[row:row + 10, column:column + 10] = True
    scatter_boxes(walls, 50, 6, 40, rng)
    return walls


def alcoves(rng: np.random.Generator) -> np.ndarray:
    """Return one long corridor with alcoves of many sizes on both sides: bool, shape (160, 1200)."""
    walls = np.ones((160, 1200), dtype=bool)
    walls[56:104, 20:1180] = False
    for side in (0, 1):
        column = 30 + int(rng.integers(0, 60))
        while column < 1130:
            depth, width = rng.integers(6, 34), rng.integers(10, 44)
            walls[56 - depth:56, column:column + width] = False if side else walls[56 - depth:56, column:column + width]
            walls[104 : 104 + depth, column : column + width] = (
                walls[104 : 104 + depth, column : column + width] if side else False
            )
            column += int(width + rng.integers(20, 140))
    return walls


def loop_of_rooms(rng: np.random.Generator) -> np.ndarray:
    """Return rooms around a block, each joined to the next by a door: bool, shape (480, 640)."""
    walls = shell(480, 640)
    walls[140:340, 150:490] = True
    for column in (150, 262, 374, 486):
        for band in (slice(4, 140), slice(340, 476)):
            walls[band, column:column + 4] = True
            door = band.start + int(rng.integers(15, 95))
            walls[door:door + 22, column:column + 4] = False
    for row in (140, 238, 336):
        for band in (slice(4, 150), slice(490, 636)):
            walls[row:row + 4, band] = True
            door = band.start + int(rng.integers(15, 100))
            walls[row:row + 4, door:door + 22] = False
    scatter_boxes(walls, 24, 6, 22, rng)
    return walls


def warehouse(rng: np.random.Generator) -> np.ndarray:
    """Return aisles between racks all alike, with pallets in some of them: bool, shape (520, 760)."""
    walls = shell(520, 760)
    for row in range(60, 460, 72):
        for left, right in ((50, 360), (410, 710)):
            walls[row:row + 22, left:right] = True
            for bay in range(left, right - 16, 18):
                if rng.random() < 0.4:
                    walls[row:row + rng.integers(6, 16), bay:bay + 15] = False
    scatter_boxes(walls, 25, 12, 24, rng)
    return walls


def open_hall(rng: np.random.Generator) -> np.ndarray:
    """Return a large hall with next to nothing in it: bool, shape (520, 680)."""
    walls = shell(520, 680)
    for _ in range(6):
        row, column = rng.integers(60, 440), rng.integers(60, 600)
        walls[row:row + 8, column:column + 8] = True
    for _ in range(8):
        column, depth, width = rng.integers(20, 600), rng.integers(6, 16), rng.integers(10, 50)
        walls[:4 + depth, column:column + width] = True
        column = rng.integers(20, 600)
        walls[-4 - depth:, column:column + width] = True
    return walls


def alike(rng: np.random.Generator) -> np.ndarray:
    """Return an office whose rooms are copies of two, bare but for a cupboard: bool, shape (400, 640)."""
    walls = shell(400, 640)
    walls[178:181], walls[219:222] = True, True
    for left in range(0, 600, 80):
        walls[:180, left:left + 3] = walls[220:, left:left + 3] = True
        walls[178:181, left + 30:left + 50] = walls[219:222, left + 30:left + 50] = False
        if rng.random() < 0.5:
            walls[20:60, left + 3:left + 13] = True
        if rng.random() < 0.5:
            walls[340:380, left + 3:left + 13] = True
    return walls


FAMILIAR = ("office", "corridors", "hall")
"""The kinds on whose drives, with seeds below 10, the filter's constants were chosen."""

BUILDINGS: Dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "office": office, "corridors": corridors, "hall": hall, "alcoves": alcoves, "loop of rooms": loop_of_rooms,
    "warehouse": warehouse, "open hall": open_hall, "alike": alike,
}


def shell(height: int, width: int) -> np.ndarray:
    """Return four walls around nothing."""
    walls = np.zeros((height, width), dtype=bool)
    walls[:4] = walls[-4:] = True
    walls[:, :4] = walls[:, -4:] = True
    return walls


def scatter_boxes(walls: np.ndarray, count: int, smallest: int, largest: int, rng: np.random.Generator) -> None:
    """Add so many boxes, of `smallest` to `largest` cells a side."""
    for _ in range(count):
        row, column = rng.integers(8, walls.shape[0] - 40), rng.integers(8, walls.shape[1] - 40)
        walls[row:row + rng.integers(smallest, largest), column:column + rng.integers(smallest, largest)] = True
