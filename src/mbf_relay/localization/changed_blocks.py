"""Blocks of the map that are not as the map has them any more: walls that were built or taken away, racks moved.

From a pose that can be believed, each beam says something of the blocks it meets (the classes of als_ros): it ends on
something the map has; it ends where the map has nothing; it passes through what the map has. Of each block the share of
the beams that contradict the map is averaged over the last metres in which the block was seen, so that who walked by is
forgotten and what stays is kept (compare Biber and Duckett 2005; Meyer-Delius et al. 2010, whose maps are of cells).
"""

from __future__ import annotations

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.change_kernels import average_blocks, count_beams
from mbf_relay.localization.distance_field import OCCUPIED_FROM, DistanceField
from mbf_relay.localization.evidence import WALL_MARGIN
from mbf_relay.maps import FREE as UNCHANGED
from mbf_relay.maps import OCCUPIED as CHANGED
from mbf_relay.maps import UNKNOWN as NOT_SEEN
from mbf_relay.maps import OccupancyMap

CHANGED_FROM = 0.5
"""Share of a block's beams that contradict the map from which it has changed."""
ENOUGH_BEAMS = 3.0
"""Beams of a scan that see a block as well as more would."""
SEEN_FROM = 0.5
"""Scans' worth of news, about metres, from which a block was seen."""
REMEMBERED = 5.0
"""Scans' worth of news over which a block's beams are averaged."""


class ChangedBlocks:
    """Counts, block by block, how beams agree with the map."""

    def __init__(self, field: DistanceField, side: float, sigma: float) -> None:
        """Count on a map.

        Args:
            field: The map.
            side: Of a block (m); rounded to whole cells.
            sigma: Deviation (m) of a beam's end from the wall it hit.
        """
        self._field = field
        self._side = max(1, round(side / field.resolution))
        sigma = max(sigma, field.resolution)
        self._hits = np.exp(-0.5 * np.square(field.face_distances / sigma)).astype(np.float32)
        height, width = field.codes.shape
        self._shape = -(-height // self._side), -(-width // self._side)
        blocks = self._shape[0] * self._shape[1]
        self._counts = np.zeros((3, blocks), dtype=np.float32)
        self._touched = np.empty(blocks, dtype=np.int64)
        self._walled = self._has_walls()
        self.forget()

    def _has_walls(self) -> np.ndarray:
        """Return which blocks the map has anything in, shape (blocks,)."""
        walled = np.zeros(self._shape, dtype=bool)
        data, starts = self._field.occupancy.data, np.arange(0, self._field.codes.shape[1], self._side)
        for row in range(self._shape[0]):
            band = (data[row * self._side:(row + 1) * self._side] >= OCCUPIED_FROM).any(axis=0)
            walled[row] = np.logical_or.reduceat(band, starts)
        return walled.ravel()

    def forget(self) -> None:
        """Forget all that was counted, such as what was counted from a pose that turned out wrong."""
        self._unlike = np.zeros(self._counts.shape[1], dtype=np.float32)
        self._seen = np.zeros(self._counts.shape[1], dtype=np.float32)

    def go_on_from(self, before: ChangedBlocks) -> None:
        """Take over what was counted on the same map, where blocks are as large."""
        if before._side == self._side:
            self._unlike, self._seen = before._unlike, before._seen

    def look(self, pose: np.ndarray, endpoints: np.ndarray, laser: np.ndarray, news: float) -> None:
        """Count a scan.

        Args:
            pose: Of the base, shape (3,), in the map's frame: one that is right.
            endpoints: Where beams end, shape (B, 2), in the base's frame.
            laser: Position of the sensor in the base's frame, shape (2,).
            news: Share of the scan, 0 to 1, that earlier ones have not told.
        """
        field = self._field
        found = count_beams(
            np.ascontiguousarray(pose, dtype=float), endpoints, laser, field.occupancy.data, field.codes, self._hits,
            field.cell_distances, field.frame, WALL_MARGIN, self._side, self._counts, self._touched,
        )
        average_blocks(
            self._counts, self._touched, found, self._walled, news, ENOUGH_BEAMS, REMEMBERED, self._seen, self._unlike
        )

    def changed(self) -> np.ndarray:
        """Return which blocks changed, shape (blocks,); none that was not seen."""
        found: np.ndarray = (self._unlike > CHANGED_FROM) & (self._seen >= SEEN_FROM)
        return found

    def holds(self, pose: np.ndarray, endpoints: np.ndarray) -> np.ndarray:
        """Return which beams of a scan from a pose, shape (3,), end in a block that changed; (B, 2) in, (B,) out."""
        field = self._field
        points = Pose2D(*map(float, pose)).relative_to(field.origin).transform_points(endpoints)
        columns, rows = np.floor(points / (self._side * field.resolution)).astype(np.int64).T
        on_map = (columns >= 0) & (columns < self._shape[1]) & (rows >= 0) & (rows < self._shape[0])
        found = np.zeros(len(endpoints), dtype=bool)
        found[on_map] = self.changed()[rows[on_map] * self._shape[1] + columns[on_map]]
        return found

    def as_map(self) -> OccupancyMap:
        """Return a cell for each block: 100 where it changed, 0 where it is as the map has it, -1 where not seen."""
        seen = np.where(self._seen >= SEEN_FROM, np.int8(UNCHANGED), np.int8(NOT_SEEN))
        data = np.where(self.changed(), np.int8(CHANGED), seen).reshape(self._shape)
        return OccupancyMap(data, self._side * self._field.resolution, self._field.origin)
