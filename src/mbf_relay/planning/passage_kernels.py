"""Compiled look at a path's surroundings: which of its cells lie too near an obstacle."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254


@kernel("void(uint8[:,::1], int64[:,::1], float64, boolean[::1])")
def mark_narrow(costs, cells, radius, narrow):
    """Mark the cells that have a lethal one nearer than a radius, centre to centre.

    Args:
        costs: Shape (height, width).
        cells: Shape (N, 2): columns and rows on the map.
        radius: In cells.
        narrow: Shape (N,), filled.
    """
    height, width = costs.shape
    reach = np.int64(math.ceil(radius))
    halves = np.full(reach + 1, -1, np.int64)  # how far each row of the disc goes to either side
    for dy in range(reach + 1):
        while (halves[dy] + 1) * (halves[dy] + 1) + dy * dy < radius * radius:
            halves[dy] += 1
    for n in range(cells.shape[0]):
        x, y = cells[n, 0], cells[n, 1]
        if n > 0 and x == cells[n - 1, 0] and y == cells[n - 1, 1]:
            narrow[n] = narrow[n - 1]
            continue
        narrow[n] = False
        for near_y in range(max(y - reach, 0), min(y + reach + 1, height)):
            half = halves[abs(near_y - y)]
            hits = 0
            for near_x in range(max(x - half, 0), min(x + half + 1, width)):
                hits += np.int64(costs[near_y, near_x] == _LETHAL)  # without a branch: many cells at a time
            if hits > 0:
                narrow[n] = True
                break
