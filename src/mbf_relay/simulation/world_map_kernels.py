# mypy: allow-untyped-defs, allow-untyped-calls
"""What can be reached on a map without crossing a wall."""

from __future__ import annotations

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(uint8[:,::1], int64, int64)")
def flood(cells, column, row):
    """Set the cells that hold 1 to 2 where they are connected with a cell, side by side, that cell included.

    Args:
        cells: Shape (height, width), 0 and 1; filled with 2 where it is reached.
        column, row: Of a cell that holds 1.
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
