"""Collision checks of the footprint on a costmap: for poses, along paths and for batches of trajectories."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay import distance_kernels
from mbf_relay.costmap import footprint_checker_kernels, footprint_kernels, sight_kernels
from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import Pose2D

CORNER_MOVES = 0.042
"""Cells that the outermost corner may move between a heading and the nearest precomputed one."""
LEAST_HEADINGS = 64
"""Precomputed headings of a full circle, at least; their number is a multiple of it."""
MOST_DRAWN = 8_000_000
"""Outline points of all precomputed headings, 64 MiB. Larger robots get fewer headings and an error of up to a cell."""
FAR = np.float32(1e6)
"""Distance (cells) where there is no obstacle: finite, so that it can be computed with."""
APART = 1.5
"""Cells: above sqrt(2), the largest distance between the centres of cells that touch, and so the most by which their
distances to an obstacle differ."""


class FreeWay(NamedTuple):
    """How far each of N trajectories is free of contact.

    Attributes:
        steps: Shape (N,), int64: number of poses before the first contact.
        highest_costs, summed_costs: Shape (N,): highest and summed cost of the cells under the base at these poses.
    """

    steps: np.ndarray
    highest_costs: np.ndarray
    summed_costs: np.ndarray


class FootprintChecker:
    """Collision checker for one snapshot, shared by planners, controllers and recovery behaviours.

    The outline is sampled every third of a cell. It is in contact where a point lies in a lethal or unknown cell, or
    outside the grid, deeper than the costmap's `obstacle_overlap` (a share of a cell) from a free neighbour cell: an
    obstacle may lie anywhere in its cell, on average half a cell deep. (costmap_2d draws lines between the corners'
    cells, with errors of that size both ways.) Distance fields are computed when first needed, and kept.

    Args:
        costmap: The snapshot.
        unknown_touches: Whether unknown cells and what lies outside the grid count as obstacles.

    Attributes:
        step: Recommended distance (m) between poses to check: a fifth of a cell.
        turn_step: Recommended angle (rad) between headings on one spot; the outermost corner then moves by `step`.
        longest_step, longest_turn: Largest distance (m) and angle (rad) between poses to check. With more, an edge of
            the footprint may pass over a single lethal cell between two poses.
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
        """Return `distances_to_obstacles`, exact at least up to `farthest` (cells)."""
        if farthest > self._known_to:
            self._distances, self._known_to = distances_to_obstacles(self._costs, farthest, self._highest), farthest
        return self._distances

    def touches(self, poses: np.ndarray) -> np.ndarray:
        """Return for each pose, (N, 3), whether the footprint is in contact: (N,), bool. Needs no distance field."""
        touching = np.empty(len(poses), np.uint8)
        footprint_checker_kernels.touching(
            self._costs, *self._place, self._outlines, self._boxes, self._radius, self._overlap, self._highest,
            np.ascontiguousarray(poses, dtype=float), touching,
        )
        return touching.astype(bool)

    def leaves_grid(self, poses: np.ndarray) -> np.ndarray:
        """Return for each pose, (N, 3), whether a corner of the footprint lies outside the grid: (N,), bool."""
        headings = np.ascontiguousarray(poses[:, 2:])
        sines, cosines = np.sin(headings), np.cos(headings)
        x, y = self._corners.T
        corners = np.stack((poses[:, :1] + cosines * x - sines * y, poses[:, 1:2] + sines * x + cosines * y), axis=2)
        grid = self.costmap.grid
        inside = grid.contains_cells(grid.cells_at(corners.reshape(-1, 2))).reshape(corners.shape[:2])
        return ~np.asarray(inside.all(axis=1))

    def contacts_at(self, pose: Pose2D, scale: float = 1.0) -> int:
        """Return how many points of the outline, a third of a cell apart, are in contact at a pose."""
        return int(
            footprint_checker_kernels.contacts(
                self._costs, *self._place, self._outlines, self._radius, self._overlap, self._highest,
                pose.x, pose.y, pose.theta, scale,
            )
        )

    def depths_at(self, pose: Pose2D) -> np.ndarray:
        """Return how deep (cells) the footprint penetrates obstacles, shape (2,): the largest depth, and their sum.

        Both are -1 without contact, and where there are too many cells to look at; see `MOST_LOOKED_AT`. A cell wholly
        within the footprint counts although the outline does not touch it: something may stand within the padding.
        """
        return self._depths_and_outs(pose)[0]

    def _depths_and_outs(self, pose: Pose2D) -> Tuple[np.ndarray, np.ndarray]:
        """Return `depths_at` a pose, and the ways out of what is penetrated there; see the kernel `depths`."""
        found, nothing = np.empty(2), np.full(2, -1.0)
        outs = np.zeros((footprint_checker_kernels.OUTS, 2))
        footprint_checker_kernels.depths(
            self._costs, *self._place, self._corners, self._radius, self._overlap, self._highest,
            pose.x, pose.y, pose.theta, 1.0, np.zeros(0), outs, found)
        touches = math.isfinite(found[0]) and (found[0] > 0.5 - self._overlap or self.contacts_at(pose))
        return found if touches else nothing, outs

    def first_contacts(
        self, poses: np.ndarray, counts: np.ndarray, scales: np.ndarray, begin: Optional[Pose2D] = None
    ) -> FreeWay:
        """Return how far each trajectory of a batch is free, and the costs it passes.

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous, in the costmap's frame.
            counts: Shape (N,), int64: number of poses of each trajectory.
            scales: Shape (N,), float64: factor on the footprint.
            begin: The robot's pose. If the footprint is in contact there, a trajectory may go on as long as it enters
                nothing deeper, on any side. None: any contact ends a trajectory.
        """
        known = self._radius * float(scales.max(initial=0.0)) / self.costmap.grid.resolution + APART
        way = FreeWay(np.empty(len(poses), np.int64), np.empty(len(poses)), np.empty(len(poses)))
        start, outs = np.zeros(0), np.zeros((footprint_checker_kernels.OUTS, 2))
        if begin is not None:
            depths, outs = self._depths_and_outs(begin)
            if depths[0] >= 0.0:
                x, y, side = self._place
                start = np.array(
                    [(begin.x - x) / side, (begin.y - y) / side, math.cos(begin.theta), math.sin(begin.theta)])
                outs = outs[np.argsort(-np.hypot(outs[:, 0], outs[:, 1]))]  # the longest one lets most cells be left
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
            start,
            outs,
            way.steps,
            way.highest_costs,
            way.summed_costs,
        )
        return way

    def meets_something(self, poses: np.ndarray, counts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return which trajectories end at an obstacle, and not at the edge of the grid: (N,), bool.

        Whoever brakes for obstacles must not brake for the edge of a small rolling window.

        Args:
            poses, counts: As for `first_contacts`.
            steps: Shape (N,): the `steps` it returned.
        """
        found = steps < counts
        cut = np.flatnonzero(found)
        if len(cut):  # rare, and `leaves_grid` takes as long for no pose as for a few
            found[cut] = ~self.leaves_grid(poses[cut, steps[cut]])
        return np.asarray(found)

    def free_steps(self, poses: np.ndarray, begin: Optional[Pose2D] = None) -> int:
        """Return the number of poses of a trajectory, (S, 3), before the first contact; see `first_contacts`."""
        if len(poses) == 0:
            return 0
        batch = np.ascontiguousarray(poses, dtype=float)[None]
        return int(self.first_contacts(batch, np.array([len(poses)]), np.ones(1), begin).steps[0])

    def clearance_along(self, points: np.ndarray, farthest: float = math.inf) -> float:
        """Return the least distance (m) from the robot's sides to an obstacle's cell along points (N, 2) in metres.

        Distances are interpolated between cells' centres. Points outside the outermost centres are left out; infinite
        where none is left. Clearances above `farthest` (m) need not be exact, which takes less time.
        """
        half_width, resolution = self.costmap.half_width, self.costmap.grid.resolution
        points = np.ascontiguousarray(points)
        distances = self._distances_to((farthest + half_width) / resolution + 0.5 + APART)
        least: float = distance_kernels.least_distance(distances, *self._place, points)
        return (least - 0.5) * resolution - half_width

    def in_sight(self, pose: Pose2D, points: np.ndarray) -> np.ndarray:
        """Return which points, (N, 2) in metres, have no lethal or unknown cell on the line from `pose`: (N,), bool."""
        seen = np.empty(len(points), np.uint8)
        sight_kernels.in_sight(
            self._costs, *self._place, pose.x, pose.y, np.ascontiguousarray(points), seen
        )
        return seen.astype(bool)

    def sees_way(self, pose: Pose2D, poses: np.ndarray) -> bool:
        """Return whether the footprint's corners at each of poses, (N, 3), are in line of sight of `pose`.

        Lines end APART cells before the corner: an obstacle right beside the corner is passed, and hides nothing.
        """
        return bool(sight_kernels.sees_way(
            self._costs, *self._place, pose.x, pose.y, self._corners, np.ascontiguousarray(poses, dtype=float),
            APART * self.costmap.grid.resolution))

    def clearance_at(self, x: float, y: float) -> float:
        """Return the distance (m) from the centre of a point's cell to that of the nearest obstacle; 0 off the grid."""
        column, row = self.costmap.grid.cell_at(x, y)
        if not self.costmap.grid.contains_cell(column, row):
            return 0.0
        return float(self._distances_to()[row, column]) * self.costmap.grid.resolution

    def clearances_at(self, poses: np.ndarray) -> np.ndarray:
        """Return `clearance_at` (m), shape (...), for poses or points of shape (..., 2 or more) in metres."""
        grid = self.costmap.grid
        columns = np.floor((poses[..., 0] - grid.origin_x) / grid.resolution).astype(np.int64)
        rows = np.floor((poses[..., 1] - grid.origin_y) / grid.resolution).astype(np.int64)
        inside = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
        found = self._distances_to()[np.where(inside, rows, 0), np.where(inside, columns, 0)]
        return np.where(inside, found * grid.resolution, 0.0)


def distances_to_obstacles(
    costs: np.ndarray, farthest: float = math.inf, highest: int = NO_INFORMATION
) -> np.ndarray:
    """Return each cell's distance (cells) to the nearest obstacle cell, centre to centre: (H, W) uint8 in, float32 out.

    Args:
        costs: Shape (H, W), uint8.
        farthest: Cells up to which distances are exact; beyond, a value is only known to be larger.
        highest: Obstacles are cells from LETHAL up to this cost.
    """
    free = costs < LETHAL if highest == NO_INFORMATION else costs != LETHAL
    distances = distances_to_zeros(free, farthest)
    return np.minimum(distances, FAR, out=distances)


def _corners(footprint: np.ndarray) -> np.ndarray:
    """Return the corners of an outline, (K, 2); a single one at the base's origin where there is no outline."""
    return footprint[:, :2] if len(footprint) else np.zeros((1, 2))


@lru_cache(maxsize=8)
def _outlines(
    footprint: bytes, corners: int, resolution: float
) -> Tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return a footprint's outline turned to each of A headings of a full circle.

    Args:
        footprint: Bytes of the corners, float64, shape (K, 2) in metres: hashable, for the cache.
        corners: Their number, K.
        resolution: Side (m) of a cell.

    Returns:
        Points a third of a cell apart around the outline, (A, P, 2) float32 metres; their bounding boxes, (A, 4)
        float32: least x, least y, largest x, largest y; circles around each ARC points, (A, K, 3) float32 for K arcs:
        x, y, radius; and the circumscribed radius (m). Boxes and circles are a thousandth of a cell larger for
        rounding.
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
