"""Paths the robot fits along: a second look at a planner's path, with the footprint's width instead of its inscribed circle."""

from __future__ import annotations

import dataclasses

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import passage_kernels
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner

SIDES = 0.25  # cells: how much less than its half width a passage may be, as footprint checks overlap cells by as much
TRIES = 8
DETOUR_FACTOR, DETOUR_LENGTH = 1.5, 1.0  # the longest way round: this times the path, and this many metres more
AT_ENDS = 0.15  # m at start and goal that are not looked at: the robot stands there, or is to


def plan_with_room(
    planner: Planner, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
) -> Path:
    """Return a planner's path, led round passages narrower than the robot where there is such a way.

    Planners keep the robot's centre out of INSCRIBED cells, so a long or off-centre footprint, whose inscribed circle
    is small, is sent through gaps it cannot pass. Here the path is looked at with the footprint's half width; where it
    is too narrow, these cells are closed and the planner is asked again. Where that finds no way, or a much longer one,
    the first path stands: it may be that obstacles are only marked too large.

    Arguments and errors as for Planner.plan.
    """
    first = path = planner.plan(costmap, start, goal, tolerance, cancelled)
    room = costmap.half_width + (0.5 - SIDES) * costmap.grid.resolution
    if room <= costmap.inscribed_radius + costmap.grid.resolution:
        return first
    picture = costmap
    for _ in range(TRIES):
        narrow = narrow_cells(costmap, path, room)
        if len(narrow) == 0:
            return path
        picture = _closed(picture, narrow)
        try:
            path = planner.plan(picture, start, goal, tolerance, cancelled)
        except PlanningError as error:
            if error.outcome is PlanOutcome.CANCELED:
                raise
            return first
        if path.length > DETOUR_FACTOR * first.length + DETOUR_LENGTH:
            return first
    return first


def narrow_cells(costmap: CostGrid, path: Path, room: float) -> np.ndarray:
    """Return the cells of a path, (N, 2) in its order, that have a lethal cell nearer than `room` (m), its ends left out."""
    places = path.poses[:, :2]
    between = (np.hypot(*(places - places[0]).T) > AT_ENDS) & (np.hypot(*(places - places[-1]).T) > AT_ENDS)
    cells = costmap.grid.cells_at(places[between])
    cells = np.ascontiguousarray(cells[costmap.grid.contains_cells(cells)], dtype=np.int64)
    narrow = np.zeros(len(cells), dtype=np.bool_)
    passage_kernels.mark_narrow(costmap.costs, cells, room / costmap.grid.resolution, narrow)
    return cells[narrow]


def _closed(costmap: CostGrid, cells: np.ndarray) -> CostGrid:
    """Return a picture in which these cells and their neighbours may not be passed."""
    costs = costmap.costs.copy()
    height, width = costs.shape
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            columns, rows = np.clip(cells[:, 0] + x, 0, width - 1), np.clip(cells[:, 1] + y, 0, height - 1)
            costs[rows, columns] = np.maximum(costs[rows, columns], INSCRIBED)
    return dataclasses.replace(costmap, costs=costs, revision=0, history=())
