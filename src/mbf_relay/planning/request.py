"""Checks of start and goal before a search, and alternatives where they are blocked."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, NO_INFORMATION, CostGrid, Window
from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.passage import checker_on
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import reach_kernels

Cell = Tuple[int, int]

OUT_OF_A_DOCK = 4.0
"""Distance, in widths of the robot, that a path may lead out of a blocked start over INSCRIBED cells, as in a dock
whose walls are nearer than the inscribed radius."""
_COSTS = np.arange(256)
DETOUR = 2.0 * math.pi
"""Longest extra way, in tolerances, to a place near the goal compared with the first one reached: once around the goal.
"""


def require_finite(start: Pose2D, goal: Pose2D) -> None:
    """Raise PlanningError INVALID_START or INVALID_GOAL where a pose is not finite."""
    for what, pose, outcome in (("start", start, PlanOutcome.INVALID_START), ("goal", goal, PlanOutcome.INVALID_GOAL)):
        if not pose.is_finite():
            raise PlanningError(outcome, f"the {what} {tuple(pose)} is not finite")


def outside_error(costmap: CostGrid, what: str, pose: Pose2D) -> PlanningError:
    """Return OUT_OF_MAP for a pose outside the costmap; `what` is "start" or "goal"."""
    grid = costmap.grid
    return PlanningError(
        PlanOutcome.OUT_OF_MAP,
        f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies outside the costmap, which reaches from ({grid.origin_x:.3f}, "
        f"{grid.origin_y:.3f}) to ({grid.origin_x + grid.width * grid.resolution:.3f}, "
        f"{grid.origin_y + grid.height * grid.resolution:.3f}) in {costmap.frame}")


def blocked_error(costmap: CostGrid, what: str, pose: Pose2D, outcome: PlanOutcome) -> PlanningError:
    """Return the error, with `outcome`, for a pose in a cell that must not be entered; `what` is "start" or "goal"."""
    column, row = costmap.grid.cell_at(pose.x, pose.y)
    cost = int(costmap.costs[row, column])
    reason = {LETHAL: "in an obstacle", NO_INFORMATION: "in unknown space"}.get(
        cost, f"nearer than {costmap.inscribed_radius:.3f} m to an obstacle")
    return PlanningError(outcome, f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies {reason} (cost {cost})")


def unreachable_error(start: Pose2D, goal: Pose2D, tolerance: float) -> PlanningError:
    """Return NO_PATH_FOUND for a goal that no free cells connect with the start; the tolerance is in metres."""
    near = f", nor to any point within {tolerance:.3f} m of it" if tolerance > 0.0 else ""
    return PlanningError(
        PlanOutcome.NO_PATH_FOUND,
        f"no free cells connect the start ({start.x:.3f}, {start.y:.3f}) to the goal ({goal.x:.3f}, "
        f"{goal.y:.3f}){near}",
    )


def start_cell(costmap: CostGrid, start: Pose2D) -> Cell:
    """Return the cell of the costmap that is nearest to a start: its own, or one at the edge if it lies outside.

    Raises:
        PlanningError: OUT_OF_MAP, where the start lies outside by more than the robot's width.
    """
    column, row = costmap.grid.nearest_cell(start.x, start.y)
    if math.dist(costmap.grid.center_of(column, row), start[:2]) > costmap.width:  # which is a cell at least
        raise outside_error(costmap, "start", start)
    return column, row


def departure(costmap: CostGrid, weights: np.ndarray, start: Pose2D) -> np.ndarray:
    """Return the cells from the start's own to the first free one: (N, 2), the start's cell alone where it is free.

    From an INSCRIBED or unknown cell the free one may be as far as the inscribed radius, over any cells but lethal
    ones; over INSCRIBED cells alone, as in a dock, as far as OUT_OF_A_DOCK times the robot's width. A robot outside the
    map by no more than its width returns over the nearest cell.

    Args:
        costmap: The snapshot.
        weights: Shape (256,): cells of weight 0 are not free; see `GridPlanner.weights`.
        start: The robot's pose in the costmap's frame.

    Raises:
        PlanningError: OUT_OF_MAP or BLOCKED_START.
    """
    grid = costmap.grid
    own = grid.cell_at(start.x, start.y)
    column, row = start_cell(costmap, start)
    if (column, row) != own:
        inside = departure(costmap, weights, Pose2D(*grid.center_of(column, row), start.theta))
        return np.vstack((np.array([own], dtype=np.int32), inside))
    cost = costmap.costs[row, column]
    if weights[cost] > 0.0:
        return np.array([[column, row]], dtype=np.int32)
    may_leave_over = (costmap.inscribed_radius, _COSTS != LETHAL), (OUT_OF_A_DOCK * costmap.width, _COSTS == INSCRIBED)
    for distance, passable in may_leave_over if cost != LETHAL else ():
        reach = max(1, math.ceil(distance / grid.resolution))
        path = np.empty(((2 * reach + 1) ** 2, 2), dtype=np.int32)
        count = reach_kernels.way_out(costmap.costs, weights > 0.0, passable, column, row, reach, path)
        if count > 0:
            return path[:count]
    raise blocked_error(costmap, "start", start, PlanOutcome.BLOCKED_START)


def has_room(costmap: CostGrid, goal: Pose2D) -> bool:
    """Return whether the footprint is free of contact at a goal; unknown cells are no obstacles."""
    return not checker_on(costmap).touches(np.array([goal]))[0]


def nearest_reachable(
    costmap: CostGrid, weights: np.ndarray, start: Cell, goal: Pose2D, tolerance: float, cancelled: Cancellation
) -> Optional[Pose2D]:
    """Return the best reachable pose within `tolerance` (m) of the goal, with the goal's heading; None without any.

    Candidates are the centres of cells connected with the start by a way longer by at most DETOUR than that to the
    first such cell, which leaves out cells behind a wall. Preferred are cells where the robot can turn on the spot,
    then those where the footprint fits with the goal's heading; without any of these, the goal itself if it is
    reachable, else any cell. Of equals the one nearest to the goal is taken.

    Args:
        costmap: The snapshot.
        weights: Shape (256,): cells of weight 0 must not be entered.
        start: The start's cell, which is free.
        goal: The goal in the costmap's frame.
        tolerance: Metres.
        cancelled: Stops the search when set.

    Raises:
        PlanningError: CANCELED.
    """
    grid = costmap.grid
    goal_x, goal_y = (goal.x - grid.origin_x) / grid.resolution, (goal.y - grid.origin_y) / grid.resolution
    farthest = math.hypot(abs(goal_x) + grid.width, abs(goal_y) + grid.height)
    radius = min(tolerance / grid.resolution, farthest)  # cells
    window = Window(math.floor(goal_x - radius), math.floor(goal_y - radius),
                    math.ceil(goal_x + radius) + 1, math.ceil(goal_y + radius) + 1).within(grid)
    if window.is_empty or not (weights[costmap.costs[window.slices]] > 0.0).any():
        return None
    reached = np.zeros(costmap.costs.shape, dtype=np.uint8)
    if not reach_kernels.flood_towards(
            costmap.costs, weights > 0.0, *start, goal_x, goal_y, radius, math.ceil(DETOUR * radius), reached,
            cancelled.flag):
        raise PlanningError(PlanOutcome.CANCELED, "planning was cancelled")
    cells = np.argwhere(reached[window.slices])[:, ::-1] + (window.x0, window.y0)
    distances = np.hypot(*(cells + 0.5 - (goal_x, goal_y)).T)
    cells, distances = cells[distances <= radius + 1e-9], distances[distances <= radius + 1e-9]
    room = _room_at(costmap, window, cells, goal.theta)
    column, row = grid.cell_at(goal.x, goal.y)
    if not room.any() and grid.contains_cell(column, row) and reached[row, column]:
        return goal
    if len(cells) == 0:
        return None
    return Pose2D(*grid.center_of(*cells[np.lexsort((distances, -room))[0]].tolist()), goal.theta)


def _room_at(costmap: CostGrid, window: Window, cells: np.ndarray, heading: float) -> np.ndarray:
    """Return the room at the centres of cells, (N, 2): 2 to turn on the spot, 1 to stand with `heading`, else 0.

    Args:
        costmap: The snapshot.
        window: Holds all of the cells.
        cells: Columns and rows.
        heading: Radians.
    """
    grid = costmap.grid
    poses = np.column_stack((grid.centers_of(cells), np.full(len(cells), heading)))
    fits = (~checker_on(costmap).touches(poses)).astype(int)
    if len(costmap.footprint) == 0:
        return 2 * fits
    reach = float(np.hypot(*costmap.footprint.T).max()) / grid.resolution + 0.5  # to the centre of an obstacle's cell
    seen = window.grown(math.ceil(reach)).within(grid)
    distances = distances_to_zeros(costmap.costs[seen.slices] != LETHAL, reach)
    turns = distances[cells[:, 1] - seen.y0, cells[:, 0] - seen.x0] >= reach
    room: np.ndarray = fits * (1 + turns)
    return room
