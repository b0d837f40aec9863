"""The distance field: how far each cell of the map is from the nearest obstacle."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Optional

import numpy as np

from mbf_relay.distances import around, distances_to_zeros
from mbf_relay.geometry import Pose2D
from mbf_relay.localization.refinement_kernels import FREE_TO, OCCUPIED
from mbf_relay.maps import CHECK_THRESHOLDS, OccupancyMap

OCCUPIED_FROM = 65
"""Occupancy from which a cell of a map is occupied."""
BAND = 256
"""Rows whose distances are computed at once."""
ON_A_WALL = 0.1
"""Distance (m) from the nearest occupied cell's centre up to which a beam's end counts as explained by the map."""
DOUBTFUL = 0.5
"""Share of a scan's ends explained by the map below which the pose is in doubt."""


class DistanceField:
    """A map, with the distance from each cell to the nearest obstacle.

    Beams end on the faces of obstacles, so distances are to faces: cells deep inside of a thick obstacle are far from
    any. Each cell is stored as a code of two bytes: the squared distance in cells, which is an integer, plus OCCUPIED
    where the cell is occupied. Models look codes up in tables of their own. Where squares would not fit, on maps finer
    than 1.1 cm with a `max_distance` of 2 m, codes are distances in steps of `max_distance` / 32767.

    Attributes:
        origin: Pose of the lower left corner in the map's frame.
        resolution: Side of a cell (m).
        max_distance: Upper bound (m) of distances; also the distance off the map.
        codes: Shape (height, width), uint16.
        face_distances: For each code the distance (m) from the cell's centre to that of the nearest face cell, float32,
            at most `max_distance`. A face cell is an occupied cell with one of its eight neighbours not occupied.
        cell_distances: For each code the distance (m) to the nearest occupied cell, 0 for an occupied one, float32.
        has_free_cells: Whether any cell is free.
    """

    def __init__(self, occupancy: OccupancyMap, max_distance: float) -> None:
        """Compute the field.

        Raises:
            ValueError: The map has no cell, its resolution is not above 0, or its origin is not finite.
        """
        check_map(occupancy)
        self.occupancy = occupancy
        self.origin = occupancy.origin
        self.resolution = occupancy.resolution
        self.max_distance = max_distance
        farthest = math.ceil((max_distance / self.resolution) ** 2)
        self._squares = farthest < OCCUPIED
        self._far = farthest if self._squares else OCCUPIED - 1
        codes = np.arange(2 * OCCUPIED)
        below = codes % OCCUPIED
        distances = self.resolution * np.sqrt(below) if self._squares else max_distance / self._far * below
        self.face_distances = np.minimum(distances, max_distance).astype(np.float32)
        self.cell_distances = np.where(codes < OCCUPIED, self.face_distances, np.float32(0.0))
        self.codes = np.empty(occupancy.data.shape, dtype=np.uint16)
        for row in range(0, len(self.codes), BAND):  # in bands: float distances of a large map would take gigabytes
            self._encode(slice(row, row + BAND))
        self._free_in_rows = np.cumsum([np.count_nonzero(is_free(row)) for row in occupancy.data])
        self.has_free_cells = bool(self._free_in_rows[-1] > 0)

    def _encode(self, rows: slice) -> None:
        """Compute the codes of some rows, from the map within `max_distance` of them."""
        reach = int(min(self.max_distance / self.resolution, max(self.codes.shape))) + 2
        near = slice(max(0, rows.start - reach), rows.stop + reach)
        inner = slice(rows.start - near.start, rows.stop - near.start)
        occupied = self.occupancy.data[near] >= OCCUPIED_FROM
        inside = ~around(~occupied, outside=True)
        distances = distances_to(occupied & ~inside, self.resolution, self.max_distance)[inner]
        if self._squares:
            scaled = np.square(distances / self.resolution)
        else:
            scaled = distances * np.float32(self._far / self.max_distance)
        codes = np.where(distances < np.float32(self.max_distance), np.rint(scaled), self._far).astype(np.uint16)
        self.codes[rows] = codes + np.where(occupied[inner], np.uint16(OCCUPIED), np.uint16(0))

    @property
    def distances(self) -> np.ndarray:
        """Distance (m) from each cell's centre to that of the nearest occupied one, shape (height, width), float32."""
        distances: np.ndarray = self.cell_distances[self.codes]
        return distances

    @cached_property
    def blocked(self) -> np.ndarray:
        """Whether a cell is not free, uint8 of shape (height, width); unknown space stops a beam as a wall does."""
        return np.ascontiguousarray(~is_free(self.occupancy.data)).view(np.uint8)

    @cached_property
    def frame(self) -> np.ndarray:
        """Origin x, y, theta and resolution as the kernels take them, shape (4,)."""
        return np.array([self.origin.x, self.origin.y, self.origin.theta, self.resolution])

    def share_on_map(self, pose: Pose2D, endpoints: np.ndarray) -> Optional[float]:
        """Return the share of a scan's ends, 0 to 1, that lie on mapped obstacles; None where the scan has no end.

        Used for log texts, for a restart from a saved pose and to detect odometry that was reset, not by the filter.

        Args:
            pose: Of the base, in the map's frame.
            endpoints: Shape (H, 2) in metres, in the base's frame.
        """
        if len(endpoints) == 0:
            return None
        points = pose.relative_to(self.origin).transform_points(endpoints)
        columns, rows = np.floor(points / self.resolution).astype(np.int64).T
        height, width = self.codes.shape
        on_map = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        near = self.cell_distances[self.codes[rows[on_map], columns[on_map]]] <= max(ON_A_WALL, self.resolution)
        return float(np.count_nonzero(near)) / len(endpoints)

    def random_free_poses(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses evenly over the free space and all directions, shape (count, 3).

        Raises:
            ValueError: The map has no free cell.
        """
        if not self.has_free_cells and count > 0:
            raise ValueError(f"the map has no free cell to spread poses over; {CHECK_THRESHOLDS}")
        chosen = rng.integers(0, max(1, self._free_in_rows[-1]), count)
        rows = np.searchsorted(self._free_in_rows, chosen, side="right")
        columns = np.empty(count, dtype=np.int64)
        for row in np.unique(rows):
            drawn = rows == row
            free = np.nonzero(is_free(self.occupancy.data[row]))[0]
            columns[drawn] = free[chosen[drawn] - (self._free_in_rows[row] - len(free))]
        poses = np.empty((count, 3))
        poses[:, 0] = (columns + rng.random(count)) * self.resolution
        poses[:, 1] = (rows + rng.random(count)) * self.resolution
        poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
        return Pose2D(*self.origin).transform_poses(poses)


def check_map(occupancy: OccupancyMap) -> None:
    """Raise ValueError for a map without a cell, with a resolution not above 0, or an origin that is not finite."""
    if occupancy.data.size == 0:
        raise ValueError("the map has no cell; localization needs one with walls and free space")
    if not (np.isfinite(occupancy.resolution) and occupancy.resolution > 0.0):
        raise ValueError(f"the map's resolution is {occupancy.resolution} m; it must be above 0")
    if not occupancy.origin.is_finite():
        raise ValueError(f"the map's origin is {tuple(occupancy.origin)}; it must be finite")


def is_free(occupancy: np.ndarray) -> np.ndarray:
    """Return for each cell of an occupancy grid (0 to 100, -1 unknown) whether it is free."""
    return np.asarray((occupancy >= 0) & (occupancy <= FREE_TO))


def distances_to(occupied: np.ndarray, resolution: float, max_distance: float) -> np.ndarray:
    """Return each cell's distance (m) to the nearest occupied one, at most `max_distance`, as float32."""
    if not occupied.any():
        return np.full(occupied.shape, max_distance, dtype=np.float32)
    cells: np.ndarray = distances_to_zeros(~occupied, max_distance / resolution)
    cells *= np.float32(resolution)
    np.minimum(cells, np.float32(max_distance), out=cells)
    return cells
