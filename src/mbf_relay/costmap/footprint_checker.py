"""The footprint on a costmap: where it touches, for one pose, along paths and for batches of trajectories."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.costmap import footprint_checker_kernels, footprint_kernels, sight_kernels
from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import Pose2D

CORNER_MOVES = 0.042  # of a cell: how far half a step between the headings drawn beforehand moves the outermost corner
LEAST_HEADINGS = 64
MOST_DRAWN = 8_000_000
"""Points of all headings drawn beforehand, 64 MiB; a larger robot is drawn at fewer, and is off by up to a cell."""
FAR = np.float32(1e6)
"""Cells: farther than any obstacle, and a number one can go on with."""
APART = 1.5
"""Cells: more than cells that touch are apart, and so by how much more their distances to an obstacle can differ."""


class FreeWay(NamedTuple):
    """How far trajectories are free.

    Attributes:
        steps: Shape (N,), int64: poses before the first contact.
        highest_costs, summed_costs: Shape (N,): the highest and the summed cost under the centre at these poses.
    """

    steps: np.ndarray
    highest_costs: np.ndarray
    summed_costs: np.ndarray


class FootprintChecker:
    """Where the robot's footprint touches: the one answer for planner, controller and recovery.

    The outline is sampled every third of a cell. It touches where a point lies in a lethal or unknown cell, or outside
    the grid, by more than the costmap's `obstacle_overlap` beyond the nearest free cell: an obstacle lies anywhere in
    its cell, half a cell deep on average. (costmap_2d draws lines between the corners' cells, and is off by as much
    either way.) What a snapshot is asked many times is computed once, at the first question.

    Args:
        costmap: The snapshot.
        unknown_touches: False where the robot may be in unknown cells, and beyond the grid, of which nothing is known.

    Attributes:
        step: Best distance (m) between poses to check: a fifth of a cell.
        turn_step: Best angle (rad) between headings on one spot, by which the outermost corner moves a `step`.
        longest_step, longest_turn: Longest distance (m) and angle (rad) between poses to check: farther apart, an edge
            of the footprint may pass over a single lethal cell unnoticed.
    """

    def __init__(self, costmap: CostGrid, unknown_touches: bool = True) -> None:
        self.costmap = costmap
        grid = costmap.grid
        self._costs = np.ascontiguousarray(costmap.costs)
        self._place = (grid.origin_x, grid.origin_y, grid.resolution)
        self._highest = NO_INFORMATION if unknown_touches else LETHAL
        self._outlines, self._boxes, self._arcs, self._radius = _outlines(
            costmap.footprint.tobytes(), len(costmap.footprint), grid.resolution)
        self._corners = np.ascontiguousarray(_corners(costmap.footprint), dtype=float)
        self._overlap = costmap.obstacle_overlap
        self._distances, self._known_to = np.zeros((0, 0), dtype=np.float32), 0.0
        self.step = 0.2 * grid.resolution
        self.turn_step = self.step / max(self._radius, grid.resolution)
        self.longest_step = max(self.step, (1.0 - 2.0 * self._overlap) * grid.resolution)
        self.longest_turn = self.longest_step / max(self._radius, grid.resolution)

    def _distances_to(self, farthest: float = math.inf) -> np.ndarray:
        """Return `distances_to_obstacles`, known at least as far (cells) as that; most is asked of what is near."""
        if farthest > self._known_to:
            self._distances, self._known_to = distances_to_obstacles(self._costs, farthest, self._highest), farthest
        return self._distances

    def touches(self, poses: np.ndarray) -> np.ndarray:
        """Return for each pose, (N, 3), whether the footprint touches; no field of distances is made for it."""
        touching = np.empty(len(poses), np.uint8)
        footprint_checker_kernels.touching(
            self._costs, *self._place, self._outlines, self._boxes, self._radius, self._overlap, self._highest,
            np.ascontiguousarray(poses, dtype=float), touching,
        )
        return touching.astype(bool)

    def leaves_grid(self, poses: np.ndarray) -> np.ndarray:
        """Return for each pose, (N, 3), whether a part of the footprint lies outside the grid."""
        headings = np.ascontiguousarray(poses[:, 2:])
        sines, cosines = np.sin(headings), np.cos(headings)
        x, y = self._corners.T
        corners = np.stack((poses[:, :1] + cosines * x - sines * y, poses[:, 1:2] + sines * x + cosines * y), axis=2)
        grid = self.costmap.grid
        inside = grid.contains_cells(grid.cells_at(corners.reshape(-1, 2))).reshape(corners.shape[:2])
        return ~np.asarray(inside.all(axis=1))

    def contacts_at(self, pose: Pose2D, scale: float = 1.0) -> int:
        """Return how many points of the outline, a third of a cell apart, lie on an obstacle at a pose."""
        return int(
            footprint_checker_kernels.contacts(
                self._costs, *self._place, self._outlines, self._radius, self._overlap, self._highest,
                pose.x, pose.y, pose.theta, scale,
            )
        )

    def depths_at(self, pose: Pose2D) -> np.ndarray:
        """Return how deep (cells) the footprint reaches into what it touches, shape (2,): the deepest, and the sum.

        Both are below 0 where it touches nothing, or so much that it takes too long to tell. What lies within it is
        touched, though no side is: in its padding something may stand.
        """
        found, nothing = np.empty(2), np.full(2, -1.0)
        footprint_checker_kernels.depths(
            self._costs, *self._place, self._corners, self._radius, self._overlap, self._highest,
            pose.x, pose.y, pose.theta, 1.0, found)
        if not math.isfinite(found[0]):
            return nothing
        return found if found[0] > 0.5 - self._overlap or self.contacts_at(pose) else nothing

    def first_contacts(
        self, poses: np.ndarray, counts: np.ndarray, scales: np.ndarray, begin: Optional[Pose2D] = None
    ) -> FreeWay:
        """Return how far each trajectory of a batch is free, and what it passes.

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous.
            counts: Shape (N,), int64: poses of each trajectory.
            scales: Shape (N,), float64: factor on the footprint.
            begin: Where the robot is, if what touches there is no end of it: that may be left, or passed along a side,
                and not entered deeper.
        """
        known = self._radius * float(scales.max(initial=0.0)) / self.costmap.grid.resolution + APART
        way = FreeWay(np.empty(len(poses), np.int64), np.empty(len(poses)), np.empty(len(poses)))
        allowed = np.full(2, -1.0) if begin is None else self.depths_at(begin)
        footprint_checker_kernels.first_contacts(
            self._costs,
            self._distances_to(known),
            known,
            *self._place,
            self._outlines,
            self._arcs,
            self._corners,
            self._radius,
            self._overlap,
            self._highest,
            poses,
            counts,
            scales,
            allowed,
            way.steps,
            way.highest_costs,
            way.summed_costs,
        )
        return way

    def meets_something(self, poses: np.ndarray, counts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Tell of each trajectory of `first_contacts`, which found its free steps, whether something ends it, (N,).

        Where the grid ends nothing is: a robot whose costmap ends a few hand's breadths ahead would stand before that.
        """
        found = steps < counts
        cut = np.flatnonzero(found)
        if len(cut):  # as rarely, and `leaves_grid` takes as long for none as for a few
            found[cut] = ~self.leaves_grid(poses[cut, steps[cut]])
        return np.asarray(found)

    def free_steps(self, poses: np.ndarray, begin: Optional[Pose2D] = None) -> int:
        """Return how many of consecutive poses, shape (S, 3), come before the first contact; see `first_contacts`."""
        if len(poses) == 0:
            return 0
        batch = np.ascontiguousarray(poses, dtype=float)[None]
        return int(self.first_contacts(batch, np.array([len(poses)]), np.ones(1), begin).steps[0])

    def clearance_along(self, points: np.ndarray, farthest: float = math.inf) -> float:
        """Return the least distance (m) between obstacles and the footprint's sides on its way along points (N, 2).

        An obstacle fills its cell. Distances are interpolated between cells, or a path a hair aside could be judged a
        whole cell narrower. What lies outside the outermost cells' centres does not count; infinite where nothing else
        is left. Of more than `farthest` (m) any distance beyond may be told, which takes less time.
        """
        half_width, resolution = self.costmap.half_width, self.costmap.grid.resolution
        points = np.ascontiguousarray(points)
        distances = self._distances_to((farthest + half_width) / resolution + 0.5 + APART)
        least: float = footprint_checker_kernels.least_distance(distances, *self._place, points)
        return (least - 0.5) * resolution - half_width

    def in_sight(self, pose: Pose2D, points: np.ndarray) -> np.ndarray:
        """Tell for each point, (N, 2) in metres, whether the straight line to it from the robot is free of obstacles.
        """
        seen = np.empty(len(points), np.uint8)
        sight_kernels.in_sight(
            self._costs, *self._place, pose.x, pose.y, np.ascontiguousarray(points), seen
        )
        return seen.astype(bool)

    def sees_way(self, pose: Pose2D, poses: np.ndarray) -> bool:
        """Return whether from a pose the footprint's corners are in sight all along poses, (N, 3).

        What hides a corner by a cell or two alone is what the footprint passes, not what something may stand behind.
        """
        return bool(sight_kernels.sees_way(
            self._costs, *self._place, pose.x, pose.y, self._corners, np.ascontiguousarray(poses, dtype=float),
            APART * self.costmap.grid.resolution))

    def clearance_at(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the centre of the nearest obstacle cell; 0 outside the grid."""
        column, row = self.costmap.grid.cell_at(x, y)
        if not self.costmap.grid.contains_cell(column, row):
            return 0.0
        return float(self._distances_to()[row, column]) * self.costmap.grid.resolution

    def clearances_at(self, poses: np.ndarray) -> np.ndarray:
        """Return `clearance_at` for a batch: poses or points (..., 2 or more) in metres to an array (...)."""
        grid = self.costmap.grid
        columns = np.floor((poses[..., 0] - grid.origin_x) / grid.resolution).astype(np.int64)
        rows = np.floor((poses[..., 1] - grid.origin_y) / grid.resolution).astype(np.int64)
        inside = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
        found = self._distances_to()[np.where(inside, rows, 0), np.where(inside, columns, 0)]
        return np.where(inside, found * grid.resolution, 0.0)


def distances_to_obstacles(
    costs: np.ndarray, farthest: float = math.inf, highest: int = NO_INFORMATION
) -> np.ndarray:
    """Return the distance in cells from each cell to the nearest from lethal to `highest`: uint8 in, float32 out.

    Of more than `farthest` any distance beyond may be told.
    """
    free = costs < LETHAL if highest == NO_INFORMATION else costs != LETHAL
    distances = distances_to_zeros(free, farthest)
    return np.minimum(distances, FAR, out=distances)


def _corners(footprint: np.ndarray) -> np.ndarray:
    """Return the corners of an outline, (K, 2); of a robot without one a single one, where it is."""
    return footprint[:, :2] if len(footprint) else np.zeros((1, 2))


@lru_cache(maxsize=8)
def _outlines(
    footprint: bytes, corners: int, resolution: float
) -> Tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return points round an outline, a third of a cell apart, for each heading: (A, P, 2) float32 metres.

    And the boxes they lie in, (A, 4) float32: their least x and y and their largest, a hair wider; circles round every
    ARC of them, (A, K, 3) float32: centre and radius, a hair wider; and its radius (m).
    """
    outline = _corners(np.frombuffer(footprint).reshape(corners, -1) if corners else np.zeros((0, 2)))
    radius = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    points = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0)):
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / (resolution / 3.0)))
        points.append(start + (end - start) * (np.arange(count) / count)[:, None])
    ring = np.vstack(points)
    headings = math.ceil(math.pi * radius / (CORNER_MOVES * resolution * LEAST_HEADINGS))
    headings = LEAST_HEADINGS * max(1, min(headings, MOST_DRAWN // (len(ring) * LEAST_HEADINGS)))
    arcs = math.ceil(len(ring) / footprint_checker_kernels.ARC)
    drawn = [np.empty(shape, np.float32) for shape in ((headings, len(ring), 2), (headings, 4), (headings, arcs, 3))]
    footprint_kernels.draw(ring, footprint_checker_kernels.ARC, 1e-3 * resolution, *drawn)
    return drawn[0], drawn[1], drawn[2], radius
