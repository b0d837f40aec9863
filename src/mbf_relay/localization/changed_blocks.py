"""Detection of blocks of the map that have changed: walls built or removed, racks moved.

From a reliable pose each beam is classified as in als_ros: it ends on a mapped obstacle, it ends where none is mapped,
or it passes through a mapped one. For each block the share of beams that contradict the map is averaged over the last
metres in which the block was seen, so that people walking by are forgotten and lasting changes are kept (compare Biber
and Duckett 2005; Meyer-Delius et al. 2010, who do it for cells).
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
"""Mean share of beams that contradict the map above which a block counts as changed."""
ENOUGH_BEAMS = 3.0
"""Beams of one scan in a block from which on more add no weight."""
SEEN_FROM = 0.5
"""Sum of scans' weights from which on a block counts as seen; a scan a metre after the last one has weight 1."""
REMEMBERED = 5.0
"""Sum of scans' weights, about metres driven, over which a block's beams are averaged."""


class ChangedBlocks:
    """Averages, block by block, the share of beams that contradict the map."""

    def __init__(self, field: DistanceField, side: float, sigma: float) -> None:
        """Begin with no block seen.

        Args:
            field: Distance field of the map.
            side: Side of a block (m); rounded to whole cells.
            sigma: Standard deviation (m) of a beam's end from the wall it hit; at least a cell is used.
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
        """Return which blocks have an occupied cell, bool of shape (blocks,)."""
        walled = np.zeros(self._shape, dtype=bool)
        data, starts = self._field.occupancy.data, np.arange(0, self._field.codes.shape[1], self._side)
        for row in range(self._shape[0]):
            band = (data[row * self._side:(row + 1) * self._side] >= OCCUPIED_FROM).any(axis=0)
            walled[row] = np.logical_or.reduceat(band, starts)
        return walled.ravel()

    def forget(self) -> None:
        """Reset all blocks to not seen, as where the pose they were counted from turned out wrong."""
        self._unlike = np.zeros(self._counts.shape[1], dtype=np.float32)
        self._seen = np.zeros(self._counts.shape[1], dtype=np.float32)

    def go_on_from(self, before: ChangedBlocks) -> None:
        """Take over the averages of another instance for the same map, if its blocks have the same size."""
        if before._side == self._side:
            self._unlike, self._seen = before._unlike, before._seen

    def update(self, pose: np.ndarray, endpoints: np.ndarray, laser: np.ndarray, news: float) -> None:
        """Update the blocks with a scan.

        Args:
            pose: Of the base, shape (3,), in the map's frame; a reliable one.
            endpoints: Ends of the beams with a return (m), shape (B, 2), in the base's frame.
            laser: Position (m) of the sensor in the base's frame, shape (2,).
            news: Weight of the scan, 0 to 1: how much of it is independent of earlier scans.
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
        """Return which blocks were seen and have changed, bool of shape (blocks,)."""
        found: np.ndarray = (self._unlike > CHANGED_FROM) & (self._seen >= SEEN_FROM)
        return found

    def holds(self, pose: np.ndarray, endpoints: np.ndarray) -> np.ndarray:
        """Return which endpoints, (B, 2) in the base's frame, lie in a changed block, seen from a pose; bool (B,)."""
        field = self._field
        points = Pose2D(*map(float, pose)).relative_to(field.origin).transform_points(endpoints)
        columns, rows = np.floor(points / (self._side * field.resolution)).astype(np.int64).T
        on_map = (columns >= 0) & (columns < self._shape[1]) & (rows >= 0) & (rows < self._shape[0])
        found = np.zeros(len(endpoints), dtype=bool)
        found[on_map] = self.changed()[rows[on_map] * self._shape[1] + columns[on_map]]
        return found

    def as_map(self) -> OccupancyMap:
        """Return a map with a cell for each block: 100 changed, 0 not changed, -1 not seen."""
        seen = np.where(self._seen >= SEEN_FROM, np.int8(UNCHANGED), np.int8(NOT_SEEN))
        data = np.where(self.changed(), np.int8(CHANGED), seen).reshape(self._shape)
        return OccupancyMap(data, self._side * self._field.resolution, self._field.origin)
