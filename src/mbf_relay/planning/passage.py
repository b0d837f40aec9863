"""Paths the robot fits along: a planner's path looked at with the footprint, and led round where it would touch."""

from __future__ import annotations

from typing import Callable, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import passage_kernels
from mbf_relay.planning.narrowest import gap_at
from mbf_relay.planning.path import Path

TRIES = 8
MARKED_TOO_LARGE = 1.0  # cells by which an obstacle may reach less far than the cells it marks, on each side of a gap
DETOUR_FACTOR, DETOUR_WIDTHS = 1.5, 5.0  # the longest way round: this times the path, and this many robot's widths more


def lead_round(plan: Callable[[CostGrid], Path], costmap: CostGrid) -> Path:
    """Return the path `plan` finds, led round passages narrower than the robot where there is such a way.

    A search keeps the robot's centre out of INSCRIBED cells, so a long or off-centre footprint, whose inscribed circle
    is small, is sent through gaps it cannot pass. Here the footprint is laid along the path as the robot would drive
    it; where it touches, these cells are closed and the search is asked again. Where that finds no way, or a much
    longer one, the first path stands: it may be that obstacles are only marked too large. It does not where there is no
    other way and it leads through a gap narrower than the robot by more than obstacles can be marked too large.

    Args:
        plan: Plans on a snapshot; raises PlanningError.
        costmap: The snapshot as it is.

    Raises:
        PlanningError: That of the first plan, CANCELED, or NO_PATH_FOUND where the robot fits through no gap.
    """
    first = path = plan(costmap)
    if costmap.half_width <= costmap.inscribed_radius + (0.5 + costmap.obstacle_overlap) * costmap.grid.resolution:
        return first
    checker = checker_on(costmap)
    snapshot = costmap
    for _ in range(TRIES):
        narrow = touching_cells(checker, path)
        if len(narrow) == 0:
            return path
        snapshot = _closed(snapshot, narrow)
        try:
            path = plan(snapshot)
        except PlanningError as error:
            if error.outcome is PlanOutcome.CANCELED:
                raise
            if error.outcome is PlanOutcome.NO_PATH_FOUND and is_too_narrow(checker, touching_cells(checker, first)):
                raise  # asked last, since it takes the distances of the whole map
            return first
        if path.length > DETOUR_FACTOR * first.length + DETOUR_WIDTHS * costmap.width:
            return first
    return first


def checker_on(costmap: CostGrid) -> FootprintChecker:
    """Return the checker planners ask: whether unknown space may be entered is for their costs to say."""
    return FootprintChecker(costmap, unknown_touches=False)


def touching_cells(checker: FootprintChecker, path: Path) -> np.ndarray:
    """Return the cells of a path, (N, 2) in its order, at which the footprint touches when it is driven forward.

    Left out are the ends, as far as the robot reaches: it stands there, or is to. Between two poses at which the
    outline touches, no farther apart than the robot is long, what it touches may lie within it.
    """
    costmap = checker.costmap
    poses, arcs = driven(path.poses[:, :2], 0.5 * costmap.width)
    narrow = checker.touches(poses)
    touching = narrow.nonzero()[0]
    if len(touching) == 0:
        return np.zeros((0, 2), dtype=np.int64)
    reach = costmap.circumscribed_radius
    from_ends = [np.hypot(*(poses[touching, :2] - poses[end, :2]).T.copy()) for end in (0, -1)]
    away = np.minimum(*from_ends) > reach
    narrow[touching[~away]] = False
    touching = touching[away]
    length = float(np.ptp(costmap.footprint[:, 0]))
    for here, there in zip(touching[:-1], touching[1:]):
        if arcs[there] - arcs[here] <= length:
            narrow[here:there] = True
    cells = costmap.grid.cells_at(poses[narrow])
    on_grid: np.ndarray = cells[costmap.grid.contains_cells(cells)]
    return on_grid


def is_too_narrow(checker: FootprintChecker, cells: np.ndarray) -> bool:
    """Return whether one of some cells (N, 2) lies in a gap that the robot cannot fit through, however it is marked."""
    costmap = checker.costmap
    blocked = costmap.costs == LETHAL
    widest = costmap.width / costmap.grid.resolution - 2.0 * MARKED_TOO_LARGE
    for column, row in cells.tolist():
        distance = checker.clearance_at(*costmap.grid.center_of(column, row)) / costmap.grid.resolution
        if 2.0 * distance - 1.0 < widest and gap_at(blocked, column, row, distance) < widest:
            return True
    return False


def driven(points: np.ndarray, reach: float) -> Tuple[np.ndarray, np.ndarray]:
    """Return the poses (N, 3) of a robot driven forward along a path's points (N, 2), and their arc lengths (N,).

    Args:
        points: In metres.
        reach: How far (m) the chord whose direction the robot has goes to either side of it along the path: steps from
            cell to cell turn no robot.
    """
    poses, arcs = np.empty((len(points), 3)), np.empty(len(points))
    passage_kernels.drive(np.ascontiguousarray(points, dtype=float), reach, poses, arcs)
    return poses, arcs


def _closed(costmap: CostGrid, cells: np.ndarray) -> CostGrid:
    """Return a snapshot in which these cells and their neighbours may not be passed."""
    costs = costmap.costs.copy()
    height, width = costs.shape
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            columns, rows = np.clip(cells[:, 0] + x, 0, width - 1), np.clip(cells[:, 1] + y, 0, height - 1)
            costs[rows, columns] = np.maximum(costs[rows, columns], INSCRIBED)
    return costmap.with_costs(costs)
