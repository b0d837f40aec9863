"""What every planner checks before it searches, and what it does where start or goal themselves are blocked."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import reach_kernels

Cell = Tuple[int, int]


def require_finite(start: Pose2D, goal: Pose2D) -> None:
    """Raise PlanningError INVALID_START or INVALID_GOAL where a pose is not finite."""
    for what, pose, outcome in (("start", start, PlanOutcome.INVALID_START), ("goal", goal, PlanOutcome.INVALID_GOAL)):
        if not pose.is_finite():
            raise PlanningError(outcome, f"the {what} {tuple(pose)} is not finite")


def outside_error(costmap: CostGrid, what: str, pose: Pose2D) -> PlanningError:
    """Return the error for a pose outside the map."""
    grid = costmap.grid
    return PlanningError(
        PlanOutcome.OUT_OF_MAP,
        f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies outside the costmap, which reaches from ({grid.origin_x:.3f}, "
        f"{grid.origin_y:.3f}) to ({grid.origin_x + grid.width * grid.resolution:.3f}, "
        f"{grid.origin_y + grid.height * grid.resolution:.3f}) in {costmap.frame}")


def blocked_error(costmap: CostGrid, what: str, pose: Pose2D, outcome: PlanOutcome) -> PlanningError:
    """Return the error for a pose on a cell that may not be entered."""
    column, row = costmap.grid.cell_at(pose.x, pose.y)
    cost = int(costmap.costs[row, column])
    reason = {LETHAL: "in an obstacle", NO_INFORMATION: "in unknown space"}.get(
        cost, f"nearer than {costmap.inscribed_radius:.3f} m to an obstacle")
    return PlanningError(outcome, f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies {reason} (cost {cost})")


def unreachable_error(start: Pose2D, goal: Pose2D, tolerance: float) -> PlanningError:
    """Return the error for a goal that free cells do not connect with the start."""
    near = f", nor to any point within {tolerance:.3f} m of it" if tolerance > 0.0 else ""
    return PlanningError(
        PlanOutcome.NO_PATH_FOUND,
        f"no free cells connect the start ({start.x:.3f}, {start.y:.3f}) to the goal ({goal.x:.3f}, "
        f"{goal.y:.3f}){near}",
    )


def departure(costmap: CostGrid, weights: np.ndarray, start: Pose2D) -> np.ndarray:
    """Return the cells from the start's own to the first free one: (N, 2), the start's cell alone where it is free.

    A robot that stands too near an obstacle, or where nothing is known, may drive off within its inscribed radius.

    Raises:
        PlanningError: OUT_OF_MAP or BLOCKED_START.
    """
    grid = costmap.grid
    if not grid.contains_point(start.x, start.y):
        raise outside_error(costmap, "start", start)
    column, row = grid.cell_at(start.x, start.y)
    cost = costmap.costs[row, column]
    if weights[cost] > 0.0:
        return np.array([[column, row]], dtype=np.int32)
    if cost != LETHAL:
        reach = max(1, math.ceil(costmap.inscribed_radius / grid.resolution))
        path = np.empty(((2 * reach + 1) ** 2, 2), dtype=np.int32)
        passable = np.ones(256, dtype=np.bool_)
        passable[LETHAL] = False
        count = reach_kernels.way_out(costmap.costs, weights > 0.0, passable, column, row, reach, path)
        if count > 0:
            return path[:count]
    raise blocked_error(costmap, "start", start, PlanOutcome.BLOCKED_START)


def nearest_reachable(
    costmap: CostGrid, weights: np.ndarray, start: Cell, goal: Pose2D, tolerance: float, cancelled: Cancellation
) -> Optional[Cell]:
    """Return the cell, connected with the start, whose centre is nearest to the goal and within `tolerance` (m) of it.

    Raises:
        PlanningError: CANCELED.
    """
    grid, free = costmap.grid, weights > 0.0
    goal_x, goal_y = (goal.x - grid.origin_x) / grid.resolution, (goal.y - grid.origin_y) / grid.resolution
    radius = tolerance / grid.resolution
    # the nearest free cell, reachable or not, is as near as any can be: the flood need not look for a nearer one
    x0, x1 = max(math.floor(goal_x - radius), 0), min(math.ceil(goal_x + radius) + 1, grid.width)
    y0, y1 = max(math.floor(goal_y - radius), 0), min(math.ceil(goal_y + radius) + 1, grid.height)
    if x0 >= x1 or y0 >= y1:
        return None
    distances = np.hypot(np.arange(x0, x1)[None, :] + 0.5 - goal_x, np.arange(y0, y1)[:, None] + 0.5 - goal_y)
    distances = np.where(free[costmap.costs[y0:y1, x0:x1]], distances, np.inf)
    if distances.min() > radius:
        return None
    reached = np.zeros(costmap.costs.shape, dtype=np.uint8)
    cell = reach_kernels.nearest_reachable(
        costmap.costs, free, start[0], start[1], goal_x, goal_y, radius, float(distances.min()) + 1e-9, reached,
        cancelled.flag)
    if cell[0] == -2:
        raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
    return cell if cell[0] >= 0 else None
