"""Euclidean distance transform and dilation of grids."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay import distance_kernels


def distances_to_zeros(cells: np.ndarray, farthest: float = math.inf) -> np.ndarray:
    """Return the distance in cells from each cell to the nearest that is 0 or False, between their centres.

    Args:
        cells: Shape (height, width), bool or uint8.
        farthest: Distance (cells) up to which results are exact; a larger one may be any value above it, to save time.

    Returns:
        Shape (height, width), float32, correctly rounded roots of integers; infinite where no cell is 0.
    """
    cells = np.ascontiguousarray(cells).view(np.uint8)
    if cells.all():
        return np.full(cells.shape, np.inf, dtype=np.float32)
    distances = np.empty(cells.shape, dtype=np.float32)
    reach = math.ceil(min(farthest, sum(cells.shape)))
    if reach <= distance_kernels.SHORT:
        distance_kernels.distances_to_near_zeros(cells, reach, distances)
    else:
        distance_kernels.distances_to_zeros(cells, reach, distances)
    return distances


def around(marked: np.ndarray, outside: bool) -> np.ndarray:
    """Return which cells (height, width) are marked or have a marked one among their eight neighbours.

    Args:
        marked: Shape (height, width), bool.
        outside: Whether what lies outside counts as the cells at the border do, rather than as not marked.
    """
    padded = np.pad(marked, 1, mode="edge") if outside else np.pad(marked, 1)
    height, width = marked.shape
    columns = padded[:, :width] | padded[:, 1 : width + 1] | padded[:, 2:]
    return np.asarray(columns[:height] | columns[1 : height + 1] | columns[2:])
