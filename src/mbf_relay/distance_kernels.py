# mypy: allow-untyped-defs, allow-untyped-calls
"""The exact Euclidean distance transform (Meijster, Roerdink and Hesselink 2000), in whole numbers."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

SHORT = 24
"""Cells up to which it is quicker to look at each cell of a row than for those that are nearest."""


@kernel("void(uint8[::1], int32[::1], int32[::1], int32)")
def _down_a_row(cells, above, row, far):
    """Write how many rows before each cell of a row its column had its last 0; a loop of its own makes vector code.

    Args:
        cells: The row, shape (width,).
        above: Distances (cells) of the row before, shape (width,); may be `row` itself.
        row: Result, shape (width,).
        far: Largest distance told, which stands for "no 0 so far".
    """
    for x in range(cells.shape[0]):
        distance = above[x] + np.int32(1)
        distance = distance if distance < far else far
        row[x] = np.int32(0) if cells[x] == 0 else distance


@kernel("void(int32[::1], int32[::1])")
def _up_a_row(below, row):
    """Lower the distances (cells) of a row, shape (width,), to one more than those of the row after it, `below`."""
    for x in range(row.shape[0]):
        distance = below[x] + np.int32(1)
        row[x] = distance if distance < row[x] else row[x]


@kernel("void(float64[::1], float64, float64, float32[::1])")
def _from_a_column(places, column, square, row):
    """Write how far cells of a row are from a cell that lies in another row.

    Args:
        places: Columns of the cells, shape (N,); doubles, for they make vector code.
        column, square: Column of that cell, and the square of its distance (cells) from the row.
        row: Result (cells), shape (N,).
    """
    for x in range(places.shape[0]):
        away = places[x] - column
        row[x] = math.sqrt(np.float32(away * away + square))


@kernel("void(uint8[::1], uint16[::1], uint16)")
def _count_rows(cells, since, far):
    """Advance the distance along each column from the last 0 by one row; it stays at `far` once it got there."""
    one, zero = np.uint16(1), np.uint16(0)
    for x in range(cells.shape[0]):
        older = np.uint16(since[x] + one)
        older = older if older < far else far
        since[x] = zero if cells[x] == 0 else older


@kernel("void(uint16[::1], uint16[::1])")
def _square_nearer(above, row):
    """Set a row, which holds the distances from below, to the square of the lower ones."""
    for x in range(row.shape[0]):
        nearer = above[x] if above[x] < row[x] else row[x]
        row[x] = np.uint16(nearer * nearer)


@kernel("void(uint16[::1], uint16[::1], uint16[::1], uint16)")
def _lower_to(left, right, squared, step):
    """Lower squares of distances, shape (N,), to those of the cells at either side plus the square of their distance.

    Args:
        left, right: Squares (cells squared) of the cells so many columns before and after, shape (N,).
        squared: Result, lowered in place.
        step: Square of that number of columns.
    """
    for x in range(squared.shape[0]):
        nearer = left[x] if left[x] < right[x] else right[x]
        nearer = np.uint16(nearer + step)
        squared[x] = nearer if nearer < squared[x] else squared[x]


@kernel("void(uint16[::1], float32[::1])")
def _take_roots(squares, row):
    """Write the roots of the squares of distances, shape (N,), as float32."""
    for x in range(squares.shape[0]):
        row[x] = math.sqrt(np.float32(squares[x]))


@kernel("void(uint8[:,::1], int64, float32[:,::1])")
def distances_to_near_zeros(cells, reach, distances):
    """Do what `distances_to_zeros` does, in less time where `reach` is short: by shifted minima over whole rows.

    Args:
        cells, distances: As there; no cell need be 0.
        reach: Distance (cells), 0 to SHORT; (reach + 1)² + reach² must be below 2^16.
    """
    height, width = cells.shape
    far = np.uint16(reach + 1)
    stride = width + reach  # what lies beyond a row is far, to either side
    rows = np.full(height * stride + 2 * reach, np.uint16((reach + 1) * (reach + 1)))
    since = np.full(width, far)
    for y in range(height - 1, -1, -1):
        _count_rows(cells[y], since, far)
        rows[reach + y * stride:reach + y * stride + width] = since
    since[:] = far
    for y in range(height):
        _count_rows(cells[y], since, far)
        _square_nearer(since, rows[reach + y * stride:reach + y * stride + width])
    size = height * stride
    squares = rows[reach:reach + size].copy()
    for shift in range(1, reach + 1):  # over all rows in one loop
        _lower_to(
            rows[reach - shift:reach - shift + size], rows[reach + shift:reach + shift + size], squares,
            np.uint16(shift * shift))
    for y in range(height):
        _take_roots(squares[y * stride:y * stride + width], distances[y])


@kernel("void(uint8[:,::1], int64, float32[:,::1])")
def distances_to_zeros(cells, reach, distances):
    """Write the distance in cells from each cell's centre to that of the nearest cell that is 0.

    Squared distances are whole numbers below (width + height)², so that all but the root is exact; that is rounded to a
    float32, above 4096 cells twice.

    Args:
        cells: Shape (height, width); at least one is 0.
        reach: Distance (cells) up to which the results are right; those beyond are told some distance beyond it.
        distances: Result, shape (height, width).
    """
    height, width = cells.shape
    far = np.int32(height + width)
    reach = min(reach, np.int64(far) - 1)  # columns without a 0 are farther
    column_distances = np.empty((height, width), dtype=np.int32)
    column_distances[0] = far
    for y in range(height):
        _down_a_row(cells[y], column_distances[max(0, y - 1)], column_distances[y], far)
    nearest = np.empty(width, dtype=np.int64)  # columns, from left to right, that some cell of the row is nearest to
    begins = np.empty(width, dtype=np.int64)  # where each of them begins to be
    squares = np.empty(width, dtype=np.int64)
    places = np.arange(width).astype(np.float64)
    for y in range(height - 1, -1, -1):
        if y < height - 1:
            _up_a_row(column_distances[y + 1], column_distances[y])
        row = column_distances[y]
        last = -1
        for x in range(width):
            if row[x] > reach:
                continue
            squares[x] = np.int64(row[x]) * row[x]
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
            apart, twice = x * x - before * before + squares[x] - squares[before], 2 * (x - before)
            if apart < twice * (width - 1):
                # not negative; below 2^53 the quotient of doubles is cut to the same whole number as that of integers
                last += 1
                nearest[last], begins[last] = x, 1 + np.int64(np.float64(apart) / np.float64(twice))
        if last < 0:
            distances[y] = far
        end = width
        for index in range(last, -1, -1):
            begin, column = begins[index], nearest[index]
            _from_a_column(places[begin:end], np.float64(column), np.float64(squares[column]), distances[y, begin:end])
            end = begin


@kernel("float64(float32[:,::1], float64, float64, float64, float64[:,::1])")
def least_distance(distances, origin_x, origin_y, resolution, points):
    """Return the least of a grid's values at points, interpolated bilinearly between cells' centres; infinite for none.

    Args:
        distances: Shape (H, W), a value at each cell's centre.
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        points: Shape (N, 2) in metres; those outside the outermost centres are left out.
    """
    height, width = distances.shape
    least = math.inf
    for n in range(points.shape[0]):
        across = (points[n, 0] - origin_x) / resolution - 0.5
        up = (points[n, 1] - origin_y) / resolution - 0.5
        if not (across >= 0.0 and up >= 0.0 and across < width - 1 and up < height - 1):
            continue
        column, row = int(across), int(up)
        across -= column
        up -= row
        lower = (1.0 - across) * distances[row, column] + across * distances[row, column + 1]
        upper = (1.0 - across) * distances[row + 1, column] + across * distances[row + 1, column + 1]
        least = min(least, (1.0 - up) * lower + up * upper)
    return least
