"""Footprint check of planned paths: where the footprint would touch, the planner is asked for a way around."""

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
"""Paths checked, at most."""
MARKED_TOO_LARGE = 1.0
"""Cells by which a gap may in truth be wider, on each side, than between the cells marked."""
DETOUR_FACTOR, DETOUR_WIDTHS = 1.5, 5.0
"""Longest way around: this times the first path's length, plus this many times the robot's width."""


def lead_round(plan: Callable[[CostGrid], Path], costmap: CostGrid) -> Path:
    """Return a path around passages narrower than the robot if there is one, else the path that `plan` finds first.

    A search only keeps the robot's base out of INSCRIBED cells, and so sends a long or off-centre footprint, whose
    inscribed circle is small, through gaps it cannot pass. Here the footprint is checked along the path as the robot
    would drive it; cells of poses in contact are blocked, and `plan` is called again. If that finds no path, or a much
    longer one, the first path is returned: obstacles may be marked larger than they are. If there is no other path and
    the first one leads through a gap too narrow even so (see MARKED_TOO_LARGE), the plan fails.

    Args:
        plan: Plans on a snapshot; raises PlanningError.
        costmap: The snapshot.

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
                raise  # last, since it needs distances over the whole map
            return first
        if path.length > DETOUR_FACTOR * first.length + DETOUR_WIDTHS * costmap.width:
            return first
    return first


def checker_on(costmap: CostGrid) -> FootprintChecker:
    """Return the checker for planners: unknown cells are no obstacles, as weights say whether they may be entered."""
    return FootprintChecker(costmap, unknown_touches=False)


def touching_cells(checker: FootprintChecker, path: Path) -> np.ndarray:
    """Return the cells, (N, 2) in path order, of poses at which the footprint is in contact when driving forward.

    Poses within the circumscribed radius of start and end are left out, since the robot is there, or is to be. Poses
    between two contacts no farther apart than the robot's length are included: the obstacle may lie wholly within the
    outline there.
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
    """Return whether one of some cells, (N, 2), is in a gap too narrow even if obstacles are MARKED_TOO_LARGE."""
    costmap = checker.costmap
    blocked = costmap.costs == LETHAL
    widest = costmap.width / costmap.grid.resolution - 2.0 * MARKED_TOO_LARGE
    for column, row in cells.tolist():
        distance = checker.clearance_at(*costmap.grid.center_of(column, row)) / costmap.grid.resolution
        if 2.0 * distance - 1.0 < widest and gap_at(blocked, column, row, distance) < widest:
            return True
    return False


def driven(points: np.ndarray, reach: float) -> Tuple[np.ndarray, np.ndarray]:
    """Return the poses, (N, 3), of a robot driving forward along a path, and their arc lengths (m), (N,).

    Args:
        points: Points of the path, (N, 2) in metres.
        reach: Arc length (m) before and after each point between which the path's direction is taken as a chord; it
            smooths the zigzag of steps from cell to cell.
    """
    poses, arcs = np.empty((len(points), 3)), np.empty(len(points))
    passage_kernels.drive(np.ascontiguousarray(points, dtype=float), reach, poses, arcs)
    return poses, arcs


def _closed(costmap: CostGrid, cells: np.ndarray) -> CostGrid:
    """Return a snapshot in which some cells, (N, 2), and their eight neighbours are at least INSCRIBED."""
    costs = costmap.costs.copy()
    height, width = costs.shape
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            columns, rows = np.clip(cells[:, 0] + x, 0, width - 1), np.clip(cells[:, 1] + y, 0, height - 1)
            costs[rows, columns] = np.maximum(costs[rows, columns], INSCRIBED)
    return costmap.with_costs(costs)
