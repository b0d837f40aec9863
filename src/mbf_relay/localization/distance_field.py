"""The distance field: how far each cell of the map is from the nearest obstacle."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.distances import around, distances_to_zeros
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap

OCCUPIED_FROM = 65
FREE_TO = 25
ON_A_WALL = 0.1  # m from the nearest occupied cell's centre within which a reading's end fits the map
DOUBTFUL = 0.5
"""Share of a scan on the map's walls below which the pose is doubtful, or much has changed since the map was made."""


class DistanceField:
    """What localization knows of a map.

    Attributes:
        origin: Pose of the lower left corner in the map's frame.
        resolution: Side of a cell (m).
        distances: Shape (height, width), float32: distance (m) from the cell's centre to the nearest occupied cell's
            centre, at most `max_distance`.
        max_distance: Distance (m) that stands for "far from everything", also off the map.
        blocked: Shape (height, width), uint8: 1 where a cell is not free; unknown space stops a beam as a wall does.
    """

    def __init__(self, occupancy: OccupancyMap, max_distance: float) -> None:
        """Compute the field.

        Raises:
            ValueError: The map has no cell, or its resolution or origin means nothing.
        """
        check_map(occupancy)
        self.occupancy = occupancy
        self.origin = occupancy.origin
        self.resolution = occupancy.resolution
        self.max_distance = max_distance
        self.distances = distances_to(occupancy.data >= OCCUPIED_FROM, occupancy.resolution, max_distance)
        self.blocked = np.ascontiguousarray(~free_cells(occupancy)).view(np.uint8)

    def surface_distances(self) -> np.ndarray:
        """Return the distances (m) to the faces of obstacles, with what lies inside of thick ones far from them.

        A beam ends on a face. To the plain field a beam that ends deep in a wall fits as well as one that ends on it.
        """
        occupied = self.occupancy.data >= OCCUPIED_FROM
        inside = ~around(~occupied, outside=True)
        if not inside.any():
            return self.distances
        return distances_to(occupied & ~inside, self.resolution, self.max_distance)

    @property
    def frame(self) -> np.ndarray:
        """Origin x, y, theta and resolution as the kernels take them, shape (4,)."""
        return np.array([self.origin.x, self.origin.y, self.origin.theta, self.resolution])

    def share_on_map(self, pose: Pose2D, endpoints: np.ndarray) -> Optional[float]:
        """Return which share of a scan's ends the map explains, 0 to 1; None where the scan has no end.

        For people and for starts; the filter itself does not use it.

        Args:
            pose: Of the base, in the map's frame.
            endpoints: Shape (H, 2) in metres, in the base's frame.
        """
        if len(endpoints) == 0:
            return None
        points = pose.relative_to(self.origin).transform_points(endpoints)
        columns, rows = np.floor(points / self.resolution).astype(np.int64).T
        height, width = self.distances.shape
        on_map = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        near = self.distances[rows[on_map], columns[on_map]] <= max(ON_A_WALL, self.resolution)
        return float(np.count_nonzero(near)) / len(endpoints)

    def random_free_poses(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses evenly over the free space and all directions, shape (count, 3).

        Raises:
            ValueError: The map has no free cell.
        """
        rows, columns = np.nonzero(self.blocked == 0)
        if len(rows) == 0 and count > 0:
            raise ValueError("the map has no free cell; poses cannot be spread over it")
        chosen = rng.integers(0, max(1, len(rows)), count)
        poses = np.empty((count, 3))
        poses[:, 0] = (columns[chosen] + rng.random(count)) * self.resolution
        poses[:, 1] = (rows[chosen] + rng.random(count)) * self.resolution
        poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
        return Pose2D(*self.origin).transform_poses(poses)


def check_map(occupancy: OccupancyMap) -> None:
    """Raise ValueError where a map cannot be localized on."""
    if occupancy.data.size == 0:
        raise ValueError("the map has no cell; localization needs one with walls and free space")
    if not (np.isfinite(occupancy.resolution) and occupancy.resolution > 0.0):
        raise ValueError(f"the map's resolution is {occupancy.resolution} m; it must be above 0")
    if not occupancy.origin.is_finite():
        raise ValueError(f"the map's origin is {tuple(occupancy.origin)}; it must be finite")


def free_cells(occupancy: OccupancyMap) -> np.ndarray:
    """Tell for each cell whether it is free."""
    return (occupancy.data >= 0) & (occupancy.data <= FREE_TO)


def distances_to(occupied: np.ndarray, resolution: float, max_distance: float) -> np.ndarray:
    """Return each cell's distance (m) to the nearest occupied one, at most `max_distance`, as float32."""
    if not occupied.any():
        return np.full(occupied.shape, max_distance, dtype=np.float32)
    cells: np.ndarray = distances_to_zeros(~occupied)
    cells *= np.float32(resolution)
    np.minimum(cells, np.float32(max_distance), out=cells)
    return cells
