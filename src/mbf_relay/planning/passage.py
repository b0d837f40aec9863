"""Paths the robot fits along: a planner's path looked at with the footprint, and led round where it would touch."""

from __future__ import annotations

import dataclasses
import math
from typing import Callable, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid, Window
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.distances import distances_to_zeros
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import passage_kernels
from mbf_relay.planning.path import Path

TRIES = 4
"""Searches after the first; one mends most paths, a second those along whose detour other obstacles stand."""
PART = 200
"""Points of a path around which cells are looked at together: around all of a long one would lie half the map."""
DETOUR_FACTOR, DETOUR_WIDTHS = 1.5, 5.0  # the longest way round: this times the path, and this many robot's widths more


def lead_round(plan: Callable[[CostGrid], Path], costmap: CostGrid) -> Path:
    """Return the path `plan` finds, led round passages narrower than the robot where there is such a way.

    A search keeps the robot's centre out of INSCRIBED cells, so a long or off-centre footprint, whose inscribed circle
    is small, is sent through gaps it cannot pass. Here the footprint is laid along the path as the robot would drive
    it; where it touches, these cells are closed, with all along the path that are as narrow, and the search is asked
    again. Where that finds no way, or a much longer one, the first path stands: it may be that obstacles are only
    marked too large.

    Args:
        plan: Plans on a snapshot; raises PlanningError.
        costmap: The snapshot as it is.

    Raises:
        PlanningError: That of the first plan, or CANCELED.
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
        snapshot = _closed(snapshot, narrow, path)
        try:
            path = plan(snapshot)
        except PlanningError as error:
            if error.outcome is PlanOutcome.CANCELED:
                raise
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
    touching = np.flatnonzero(narrow)
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


def _closed(costmap: CostGrid, cells: np.ndarray, path: Path) -> CostGrid:
    """Return a snapshot in which a path's narrow cells and their neighbours may not be passed, nor others like them.

    Like them are those beside any part of the path, as far as a robot is long, that lie nearer than half its width, and
    a cell for the neighbours, to a lethal cell: the next path would only move over to these. What the robot reaches
    from the path's ends stays open.

    Args:
        costmap: The snapshot.
        cells: The narrow ones, (N, 2) columns and rows.
        path: They lie on.
    """
    grid, reach = costmap.grid, costmap.circumscribed_radius
    costs = costmap.costs.copy()
    margin = math.ceil(2.0 * reach / grid.resolution)
    passed = grid.cells_at(path.poses)
    for part in np.array_split(passed, math.ceil(len(passed) / PART)):
        (x0, y0), (x1, y1) = part.min(axis=0).tolist(), (part.max(axis=0) + 1).tolist()
        window = Window(x0, y0, x1, y1).grown(margin).within(grid)
        near = costmap.costs[window.slices]
        distances = grid.resolution * distances_to_zeros(near != LETHAL)
        like = (near < INSCRIBED) & (distances < costmap.half_width + grid.resolution)
        rows, columns = np.nonzero(like)
        found = np.column_stack((columns + window.x0, rows + window.y0))
        from_ends = [np.hypot(*(grid.centers_of(found) - path.poses[end, :2]).T) for end in (0, -1)]
        columns, rows = found[np.minimum(*from_ends) > reach].T
        costs[rows, columns] = INSCRIBED
    height, width = costs.shape
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            columns, rows = np.clip(cells[:, 0] + x, 0, width - 1), np.clip(cells[:, 1] + y, 0, height - 1)
            costs[rows, columns] = np.maximum(costs[rows, columns], INSCRIBED)
    return dataclasses.replace(costmap, costs=costs, revision=0, history=())
