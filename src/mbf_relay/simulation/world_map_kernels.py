# mypy: allow-untyped-defs, allow-untyped-calls
"""Flood fill on a map."""

from __future__ import annotations

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(uint8[:,::1], int64, int64)")
def flood(cells, column, row):
    """Fill the 4-connected region of cells with value 1 around a cell with value 2.

    Args:
        cells: Values 0 and 1, shape (height, width); changed in place.
        column, row: A cell with value 1.
    """
    height, width = cells.shape
    waiting = np.empty(1024, np.int64)
    waiting[0], count = row * width + column, 1
    cells[row, column] = 2
    while count > 0:
        count -= 1
        y, x = waiting[count] // width, waiting[count] % width
        if count + 4 > waiting.shape[0]:
            longer = np.empty(2 * waiting.shape[0], np.int64)
            longer[:count] = waiting[:count]
            waiting = longer
        for side in range(4):
            near_x = x + (side * 2 - 1 if side < 2 else 0)
            near_y = y + (side * 2 - 5 if side > 1 else 0)
            if 0 <= near_x < width and 0 <= near_y < height and cells[near_y, near_x] == 1:
                cells[near_y, near_x] = 2
                waiting[count] = near_y * width + near_x
                count += 1
