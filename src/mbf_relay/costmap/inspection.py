"""Checks of points, poses and paths and the search for a valid pose, for the services that mbf_costmap_nav offers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Dict, Iterator, List, NamedTuple, Tuple

import numpy as np

from mbf_relay.costmap import footprint_kernels
from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.geometry import Pose2D, normalize_angle

ANGLE_STEP = math.radians(5.0)
"""Largest angle (rad) between two headings tried in a search."""

POINT = np.zeros((0, 2))
"""Outline, shape (0, 2), of a robot that covers the cell under its base alone."""

BATCH = 64
"""Cells checked at once in a search."""


class PoseState(IntEnum):
    """What a robot covers, the worse the higher; numbers as in mbf_msgs' services, the same in all its versions."""

    FREE = 0
    INSCRIBED = 1
    LETHAL = 2
    UNKNOWN = 3
    OUTSIDE = 4


@dataclass(frozen=True)
class Multipliers:
    """Factors on the costs of each kind of cell; 0 stands for 1, as mbf_costmap_nav takes it."""

    lethal: float = 1.0
    inscribed: float = 1.0
    unknown: float = 1.0


class CheckResult(NamedTuple):
    """The worst state at a pose or along a path, and the sum of the covered cells' costs."""

    state: PoseState
    cost: float


class ValidPose(NamedTuple):
    """The pose a search found, with its check; the search's start where the state is LETHAL."""

    pose: Pose2D
    verdict: CheckResult


def check_point(costmap: CostGrid, x: float, y: float) -> CheckResult:
    """Return state and cost of the cell at a point (m, costmap's frame); outside the costmap the cost is 0."""
    return check_poses(costmap, np.array([[x, y, 0.0]]), POINT)[0]


def check_poses(
    costmap: CostGrid, poses: np.ndarray, outline: np.ndarray, multipliers: Multipliers = Multipliers()
) -> List[CheckResult]:
    """Return state and cost of a robot at each pose, in their order.

    Args:
        costmap: The snapshot to look at.
        poses: Shape (N, 3), in the costmap's frame.
        outline: Corners of the robot, convex, shape (K, 2) in metres, base frame; fewer than three for its cell alone.
        multipliers: Factors on the costs of each kind of cell.
    """
    counts = _counts(costmap, poses, outline)
    states, costs = _states(counts), _costs(counts, multipliers)
    return [CheckResult(PoseState(int(state)), float(cost)) for state, cost in zip(states, costs)]


def check_path(
    costmap: CostGrid, poses: np.ndarray, outline: np.ndarray, multipliers: Multipliers = Multipliers(),
    return_on: int = 0, skip_poses: int = 0,
) -> Tuple[CheckResult, int]:
    """Return the worst state along a path and the sum of its poses' costs.

    Args:
        costmap: The snapshot to look at.
        poses: Shape (N, 3), in the costmap's frame.
        outline: As for `check_poses`.
        multipliers: Factors on the costs of each kind of cell.
        return_on: Stop at the first pose whose PoseState is this or worse; 0 to check the whole path.
        skip_poses: Number of poses skipped after each one checked.

    Returns:
        The result, and the index of the last pose checked, 0 for a path without poses.
    """
    indices = np.arange(0, len(poses), 1 + skip_poses)
    counts = _counts(costmap, poses[indices], outline)
    states, costs = _states(counts), _costs(counts, multipliers)
    bad = np.flatnonzero(states >= return_on) if return_on else np.zeros(0, dtype=int)
    end = int(bad[0]) + 1 if len(bad) else len(indices)
    if end == 0:
        return CheckResult(PoseState.FREE, 0.0), 0
    return CheckResult(PoseState(int(states[:end].max())), float(costs[:end].sum())), int(indices[end - 1])


def find_valid_pose(
    costmap: CostGrid, start: Pose2D, outline: np.ndarray, distance: float, angle: float
) -> ValidPose:
    """Find the nearest pose where the robot fits.

    The start itself is tried first, then cells' centres by their distance; at each place first the start's heading,
    then headings ever further to both sides. Places whose own cell is inscribed, lethal or unknown are skipped.

    Args:
        costmap: The snapshot to look at.
        start: Where to search from, in the costmap's frame.
        outline: As for `check_poses`.
        distance: Largest distance (m) from the start.
        angle: Largest angle (rad) from the start's heading.

    Returns:
        A FREE or INSCRIBED pose; else the nearest UNKNOWN one; else the nearest OUTSIDE one; else the start, LETHAL.
    """
    headings = _headings(start.theta, angle)
    second_best: Dict[PoseState, ValidPose] = {}
    for places in _places(costmap, start, distance):
        poses = np.column_stack((np.repeat(places, len(headings), axis=0), np.tile(headings, len(places))))
        counts = _counts(costmap, poses, outline)
        # unlike in a check, LETHAL is worse than UNKNOWN, and INSCRIBED is as good as FREE
        states = np.where(counts[:, 1] > 0, int(PoseState.LETHAL), _states(counts))
        fits = np.flatnonzero(states <= PoseState.INSCRIBED)
        if len(fits):
            return _found(poses, counts, states, int(fits[0]))
        for state in (PoseState.UNKNOWN, PoseState.OUTSIDE):
            hits = np.flatnonzero(states == state)
            if len(hits) and state not in second_best:
                second_best[state] = _found(poses, counts, states, int(hits[0]))
    for state in (PoseState.UNKNOWN, PoseState.OUTSIDE):
        if state in second_best:
            return second_best[state]
    return ValidPose(start, CheckResult(PoseState.LETHAL, float(LETHAL)))


def _headings(wanted: float, tolerance: float) -> np.ndarray:
    """Return the headings (rad) to try, the wanted one first; steps even, at most ANGLE_STEP."""
    tolerance = min(tolerance, math.pi)
    steps = int(math.ceil(tolerance / ANGLE_STEP - 1e-9))
    offsets = [0.0]
    for step in range(1, steps + 1):
        turn = tolerance * step / steps
        offsets += [turn, -turn]
    return np.array([normalize_angle(wanted + offset) for offset in offsets])


def _places(costmap: CostGrid, start: Pose2D, distance: float) -> Iterator[np.ndarray]:
    """Yield batches of positions (m) to try, shape (M, 2), nearest first."""
    grid = costmap.grid
    if _is_passable(costmap, *grid.cell_at(start.x, start.y)):
        yield np.array([[start.x, start.y]])
    low, high = (grid.cell_at(start.x + off, start.y + off) for off in (-distance, distance))  # may be beyond int64
    columns = np.arange(max(0, low[0]), min(grid.width - 1, high[0]) + 1)
    rows = np.arange(max(0, low[1]), min(grid.height - 1, high[1]) + 1)
    cells = np.array(np.meshgrid(columns, rows)).reshape(2, -1).T
    cells = cells[costmap.costs[cells[:, 1], cells[:, 0]] < INSCRIBED]
    centers = grid.centers_of(cells)
    away = np.hypot(centers[:, 0] - start.x, centers[:, 1] - start.y)
    order = np.argsort(away, kind="stable")
    centers = centers[order[away[order] <= distance]]
    for first in range(0, len(centers), BATCH):
        yield centers[first:first + BATCH]


def _is_passable(costmap: CostGrid, column: int, row: int) -> bool:
    return costmap.grid.contains_cell(column, row) and costmap.costs[row, column] < INSCRIBED


def _counts(costmap: CostGrid, poses: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return what `footprint_kernels.covered_costs` counts at each pose, shape (N, 5)."""
    result = np.zeros((len(poses), 5), dtype=np.int64)
    grid = costmap.grid
    footprint_kernels.covered_costs(
        costmap.costs, grid.origin_x, grid.origin_y, grid.resolution, np.ascontiguousarray(outline, dtype=np.float64),
        np.ascontiguousarray(poses, dtype=np.float64), result,
    )
    return result


def _states(counts: np.ndarray) -> np.ndarray:
    """Return the worst state of each row of `_counts`, shape (N,)."""
    return np.select(
        [counts[:, 0] > 0, counts[:, 3] > 0, counts[:, 1] > 0, counts[:, 2] > 0],
        [int(PoseState.OUTSIDE), int(PoseState.UNKNOWN), int(PoseState.LETHAL), int(PoseState.INSCRIBED)],
        int(PoseState.FREE),
    )


def _costs(counts: np.ndarray, multipliers: Multipliers) -> np.ndarray:
    """Return the summed costs of each row of `_counts`, shape (N,)."""
    sums: np.ndarray = (
        counts[:, 1] * (LETHAL * (multipliers.lethal or 1.0))
        + counts[:, 2] * (INSCRIBED * (multipliers.inscribed or 1.0))
        + counts[:, 3] * (NO_INFORMATION * (multipliers.unknown or 1.0)) + counts[:, 4]
    )
    return sums


def _found(poses: np.ndarray, counts: np.ndarray, states: np.ndarray, index: int) -> ValidPose:
    cost = float(_costs(counts[index:index + 1], Multipliers())[0])
    return ValidPose(Pose2D(*map(float, poses[index])), CheckResult(PoseState(int(states[index])), cost))

