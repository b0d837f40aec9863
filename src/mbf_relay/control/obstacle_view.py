"""The footprint on the local costmap: where it would touch, for one pose and for batches of trajectories."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.geometry import Pose2D

HEADINGS = 256  # the outline is turned beforehand; half a step moves a burger's corner by 2 mm
OVERLAP = 0.25


class FreeWay(NamedTuple):
    """How far trajectories are free.

    Attributes:
        steps: Shape (N,), int64: poses before the first contact.
        highest_costs, summed_costs: Shape (N,): the highest and the summed cost under the centre at these poses.
    """

    steps: np.ndarray
    highest_costs: np.ndarray
    summed_costs: np.ndarray


class ObstacleView:
    """One costmap, asked many times within a cycle. Cells that are lethal or unknown are in the way.

    Args:
        costmap: The picture.
        overlap: Share of a cell by which the outline may reach into an obstacle's cell from a free one: what is marked
            there lies somewhere within, half a cell deep on the mean. costmap_2d's own check, which draws lines between
            the cells of the corners, is off by as much either way.
    """

    def __init__(self, costmap: CostGrid, overlap: float = OVERLAP) -> None:
        self.costmap = costmap
        grid = costmap.grid
        self._costs = np.ascontiguousarray(costmap.costs)
        self._distances = distances_to_obstacles(self._costs)
        spacing = grid.resolution / 3.0
        self._outlines = _outlines(costmap.footprint.tobytes(), len(costmap.footprint), spacing)
        self._place = (grid.origin_x, grid.origin_y, grid.resolution)
        corners = costmap.footprint
        self._radius = float(np.hypot(corners[:, 0], corners[:, 1]).max()) if len(corners) else 0.0
        self._overlap = overlap

    def contacts_at(self, pose: Pose2D, scale: float = 1.0) -> int:
        """Return how many points of the outline, a third of a cell apart, lie on an obstacle at a pose."""
        return int(
            trajectory_kernels.contacts(
                self._costs, self._distances, *self._place, self._outlines, self._radius, self._overlap, pose.x, pose.y,
                pose.theta, scale,
            )
        )

    def first_contacts(
        self, poses: np.ndarray, counts: np.ndarray, scales: np.ndarray, allowed: int = 0
    ) -> FreeWay:
        """Return how far each trajectory of a batch is free, and what it passes.

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous.
            counts: Shape (N,), int64: poses of each trajectory.
            scales: Shape (N,), float64: factor on the footprint.
            allowed: Contacts the robot already has; a trajectory may keep them and lose them, not add to them.
        """
        way = FreeWay(np.empty(len(poses), np.int64), np.empty(len(poses)), np.empty(len(poses)))
        trajectory_kernels.first_contacts(
            self._costs, self._distances, *self._place, self._outlines, self._radius, self._overlap, poses, counts, scales,
            allowed, way.steps, way.highest_costs, way.summed_costs,
        )
        return way

    def free_steps(self, poses: np.ndarray, allowed: int = 0) -> int:
        """Return how many of consecutive poses, shape (S, 3), come before the first contact."""
        if len(poses) == 0:
            return 0
        batch = np.ascontiguousarray(poses, dtype=float)[None]
        return int(self.first_contacts(batch, np.array([len(poses)]), np.ones(1), allowed).steps[0])

    def room_along(self, points: np.ndarray) -> float:
        """Return the least distance (m) between obstacles and the footprint's sides, were it to pass along points (N, 2).

        An obstacle fills its cell. Distances are interpolated between cells, or a path a hair aside could be judged a whole
        cell narrower. What lies outside the outermost cells' centres does not count; infinite where nothing else is left.
        """
        half_width = float(np.abs(self.costmap.footprint[:, 1]).max()) if len(self.costmap.footprint) else 0.0
        least = trajectory_kernels.least_distance(self._distances, *self._place, np.ascontiguousarray(points))
        return (least - 0.5) * self.costmap.grid.resolution - half_width

    def in_sight(self, pose: Pose2D, points: np.ndarray) -> np.ndarray:
        """Tell for each point, (N, 2) in metres, whether the straight line to it from the robot is free of obstacles."""
        seen = np.empty(len(points), np.uint8)
        trajectory_kernels.in_sight(self._costs, *self._place, pose.x, pose.y, np.ascontiguousarray(points), seen)
        return seen.astype(bool)

    def clearance_at(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the centre of the nearest obstacle cell; 0 outside the grid."""
        column, row = self.costmap.grid.cell_at(x, y)
        if not self.costmap.grid.contains_cell(column, row):
            return 0.0
        return float(self._distances[row, column]) * self.costmap.grid.resolution


def distances_to_obstacles(costs: np.ndarray) -> np.ndarray:
    """Return the distance in cells from each cell to the nearest lethal or unknown one: uint8 in, float32 out."""
    free = (costs < LETHAL).astype(np.uint8)
    if free.all():
        return np.full(costs.shape, 1e6, dtype=np.float32)
    return cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


@lru_cache(maxsize=8)
def _outlines(footprint: bytes, corners: int, spacing: float) -> np.ndarray:
    """Return points round an outline, at most `spacing` apart, for each heading: (HEADINGS, P, 2) float32 metres."""
    outline = np.frombuffer(footprint).reshape(corners, -1)[:, :2] if corners else np.zeros((1, 2))
    points = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0)):
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / spacing))
        points.append(start + (end - start) * (np.arange(count) / count)[:, None])
    ring = np.vstack(points)
    angles = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    turned = np.stack((cos * ring[:, 0] - sin * ring[:, 1], sin * ring[:, 0] + cos * ring[:, 1]), axis=2)
    return np.ascontiguousarray(turned, dtype=np.float32)
