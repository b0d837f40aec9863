# mypy: allow-untyped-defs, allow-untyped-calls
"""The exact Euclidean distance transform (Meijster, Roerdink and Hesselink 2000), in whole numbers."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(uint8[:,::1], float32[:,::1])")
def distances_to_zeros(cells, distances):
    """Write the distance in cells from each cell's centre to that of the nearest cell that is 0.

    Squared distances are whole numbers below (width + height)², so that all but the root is exact.

    Args:
        cells: Shape (height, width); at least one is 0.
        distances: Result, shape (height, width).
    """
    height, width = cells.shape
    far = height + width
    column_distances = np.empty((height, width), dtype=np.int32)
    for x in range(width):
        column_distances[0, x] = 0 if cells[0, x] == 0 else far
    for y in range(1, height):
        for x in range(width):
            column_distances[y, x] = 0 if cells[y, x] == 0 else min(far, column_distances[y - 1, x] + 1)
    for y in range(height - 2, -1, -1):
        for x in range(width):
            column_distances[y, x] = min(column_distances[y, x], column_distances[y + 1, x] + 1)

    nearest = np.empty(width, dtype=np.int64)  # columns, from left to right, that some cell of the row is nearest to
    begins = np.empty(width, dtype=np.int64)  # where each of them begins to be
    squares = np.empty(width, dtype=np.int64)
    for y in range(height):
        for x in range(width):
            squares[x] = np.int64(column_distances[y, x]) * column_distances[y, x]
        last = 0
        nearest[0], begins[0] = 0, 0
        for x in range(1, width):
            while last >= 0:
                before, begin = nearest[last], begins[last]
                if (begin - before) * (begin - before) + squares[before] <= (begin - x) * (begin - x) + squares[x]:
                    break
                last -= 1
            if last < 0:
                last = 0
                nearest[0], begins[0] = x, 0
                continue
            before = nearest[last]
            # below 2^53 the quotient of doubles rounds down to the same whole number as that of integers
            apart = (x * x - before * before + squares[x] - squares[before]) / (2.0 * (x - before))
            begin = 1 + np.int64(math.floor(apart))
            if begin < width:
                last += 1
                nearest[last], begins[last] = x, begin
        for x in range(width - 1, -1, -1):
            column = nearest[last]
            distances[y, x] = math.sqrt(np.float32((x - column) * (x - column) + squares[column]))
            if x == begins[last]:
                last -= 1
