"""What every planner checks before it searches, and what it does where the goal itself cannot be reached."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome

Cell = Tuple[int, int]


def checked_cells(costmap: CostGrid, weights: np.ndarray, start: Pose2D, goal: Pose2D) -> Tuple[Cell, Cell]:
    """Return the cells of start and goal, both free.

    Raises:
        PlanningError: INVALID_START, INVALID_GOAL, OUT_OF_MAP, BLOCKED_START or BLOCKED_GOAL; the text says what is where.
    """
    start_cell = _cell(costmap, "start", start, PlanOutcome.INVALID_START)
    goal_cell = _cell(costmap, "goal", goal, PlanOutcome.INVALID_GOAL)
    _require_free(costmap, weights, "start", start, start_cell, PlanOutcome.BLOCKED_START)
    _require_free(costmap, weights, "goal", goal, goal_cell, PlanOutcome.BLOCKED_GOAL)
    return start_cell, goal_cell


def _cell(costmap: CostGrid, what: str, pose: Pose2D, invalid: PlanOutcome) -> Cell:
    if not pose.is_finite():
        raise PlanningError(invalid, f"the {what} {tuple(pose)} is not finite")
    grid = costmap.grid
    if not grid.contains_point(pose.x, pose.y):
        raise PlanningError(
            PlanOutcome.OUT_OF_MAP,
            f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies outside the costmap, which reaches from ({grid.origin_x:.3f}, "
            f"{grid.origin_y:.3f}) to ({grid.origin_x + grid.width * grid.resolution:.3f}, "
            f"{grid.origin_y + grid.height * grid.resolution:.3f}) in {costmap.frame}")
    return grid.cell_at(pose.x, pose.y)


def _require_free(
    costmap: CostGrid, weights: np.ndarray, what: str, pose: Pose2D, cell: Cell, blocked: PlanOutcome
) -> None:
    cost = int(costmap.costs[cell[1], cell[0]])
    if weights[cost] > 0.0:
        return
    reason = {LETHAL: "an obstacle", NO_INFORMATION: "unknown space"}.get(
        cost, f"nearer than {costmap.inscribed_radius:.3f} m to an obstacle")
    raise PlanningError(blocked, f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies in {reason} (cost {cost})")


def headings_along(points: np.ndarray, final: float) -> np.ndarray:
    """Return poses (N, 3) from points (N, 2), each heading to the next one and the last at `final` (rad)."""
    poses = np.empty((len(points), 3))
    poses[:, :2] = points
    steps = np.diff(points, axis=0)
    poses[:-1, 2] = np.arctan2(steps[:, 1], steps[:, 0])
    poses[-1, 2] = math.atan2(math.sin(final), math.cos(final))
    return poses
