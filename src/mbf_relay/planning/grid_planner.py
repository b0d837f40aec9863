"""Base class of planners that search a grid: checks, tolerance and headings, around a search of the planner's own."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import NO_INFORMATION, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import points_kernels, request
from mbf_relay.planning.narrowest import narrowest_place
from mbf_relay.planning.orientation import OrientationMode, oriented
from mbf_relay.planning.passage import lead_round
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner
from mbf_relay.planning.weights import shy_of_narrow_places

Cell = Tuple[int, int]
SAME = 1e-9
"""Metres in x and in y within which two points count as equal."""


@dataclass(frozen=True)
class SearchQuery:
    """Arguments of a search; start and goal lie in cells that may be entered.

    Attributes:
        costmap: The snapshot to plan on.
        start, goal: Poses in the costmap's frame.
        start_cell, goal_cell: Their cells, (column, row).
        weights: Shape (256,): weight of each cost, see `GridPlanner.weights`, raised where the robot hardly fits.
        cancelled: Stops the search when set.
    """

    costmap: CostGrid
    start: Pose2D
    goal: Pose2D
    start_cell: Cell
    goal_cell: Cell
    weights: np.ndarray
    cancelled: Cancellation


class GridPlanner(Planner):
    """A planner that searches the cells of a costmap; derived classes implement `weights` and `search`.

    Paths avoid passages narrower than the robot, see `passage.lead_round`: where the footprint would touch, `search` is
    called again, within the same plan, on a snapshot in which these cells are blocked.

    The parameters need a `default_tolerance` (m), used where a request's own tolerance is smaller.
    """

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.wants_potential = False  # whether a watcher wants the present plan's potential

    @abc.abstractmethod
    def weights(self) -> np.ndarray:
        """Return the path cost per cell of length for each cell cost: (256,), float32, 0 where it is not entered."""

    @abc.abstractmethod
    def search(self, query: SearchQuery) -> Optional[Tuple[np.ndarray, float]]:
        """Return a path's points, (N, 2) in metres, start and goal included, and its cost; None where there is no path.

        Raises:
            PlanningError: CANCELED.
        """

    def orient(self, points: np.ndarray, start: Pose2D, goal: Pose2D) -> np.ndarray:
        """Return the poses, (N, 3), of a path, given its points, (N, 2) in metres."""
        return oriented(points, start, goal, OrientationMode.FORWARD)

    def potential(self) -> Optional[np.ndarray]:
        """Return the potential of the last search, shape (height, width), 0 where unknown; None before the first."""
        return None

    def plan(
        self, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
    ) -> Path:
        request.require_finite(start, goal)
        try:
            return lead_round(lambda snapshot: self._plan_on(snapshot, start, goal, tolerance, cancelled), costmap)
        except PlanningError as error:
            if error.outcome is not PlanOutcome.NO_PATH_FOUND:
                raise
            through_unknown = bool(self.weights()[NO_INFORMATION] > 0.0)
            place = narrowest_place(costmap, start, goal, through_unknown, cancelled)
            if place is None:
                raise
            raise PlanningError(error.outcome, f"{error.message}: {place}") from error

    def _plan_on(
        self, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
    ) -> Path:
        watcher = self.potential_watcher
        self.wants_potential = watcher is not None and watcher.is_watching()
        weights = shy_of_narrow_places(self.weights(), costmap)
        way_out = request.departure(costmap, weights, start)
        start_cell = (int(way_out[-1, 0]), int(way_out[-1, 1]))
        leaving = start
        if len(way_out) > 1:
            leaving = Pose2D(*costmap.grid.center_of(*start_cell), start.theta)
        tolerance = max(tolerance, self.parameters.default_tolerance)
        found, goal = self._find(costmap, weights, leaving, start_cell, goal, tolerance, cancelled)
        points, cost = found
        potential = self.potential() if self.wants_potential else None
        if watcher is not None and potential is not None:
            watcher.take(costmap, potential, leaving)
        if len(way_out) > 1:
            points = np.vstack((costmap.grid.centers_of(way_out[:-1]), points))
            points[0] = start[:2]
        return Path(self.orient(_without_repeats(points), start, goal), costmap.frame, cost)

    def _find(
        self, costmap: CostGrid, weights: np.ndarray, start: Pose2D, start_cell: Cell, goal: Pose2D, tolerance: float,
        cancelled: Cancellation,
    ) -> Tuple[Tuple[np.ndarray, float], Pose2D]:
        """Return points and cost of a path, as `search` does, and the pose it ends at.

        With a tolerance that pose may lie near the goal: where the goal is blocked, cannot be reached, or has no room
        for the footprint.

        Raises:
            PlanningError: OUT_OF_MAP, BLOCKED_GOAL, NO_PATH_FOUND or CANCELED.
        """
        goal_cell = costmap.grid.cell_at(goal.x, goal.y)
        error: Optional[PlanningError] = None
        if not costmap.grid.contains_cell(*goal_cell):
            error = request.outside_error(costmap, "goal", goal)
        elif weights[costmap.costs[goal_cell[1], goal_cell[0]]] == 0.0:
            error = request.blocked_error(costmap, "goal", goal, PlanOutcome.BLOCKED_GOAL)
        elif tolerance <= 0.0 or request.has_room(costmap, goal):
            found = self._search(SearchQuery(costmap, start, goal, start_cell, goal_cell, weights, cancelled))
            if found is not None:
                return found, goal
        if tolerance > 0.0:
            near = request.nearest_reachable(costmap, weights, start_cell, goal, tolerance, cancelled)
            if near is not None:
                near_cell = costmap.grid.cell_at(near.x, near.y)
                found = self._search(SearchQuery(costmap, start, near, start_cell, near_cell, weights, cancelled))
                if found is not None:
                    return found, near
        raise error or request.unreachable_error(start, goal, tolerance)

    def _search(self, query: SearchQuery) -> Optional[Tuple[np.ndarray, float]]:
        if query.start_cell != query.goal_cell:
            return self.search(query)
        self.wants_potential = False  # nothing was searched: what there is belongs to an earlier plan
        cost = query.costmap.costs[query.goal_cell[1], query.goal_cell[0]]
        cells = query.start.distance_to(query.goal) / query.costmap.grid.resolution
        return np.array([query.start[:2], query.goal[:2]]), float(query.weights[cost]) * cells


def _without_repeats(points: np.ndarray) -> np.ndarray:
    """Return points, (N, 2), without those equal to the one before, which would have no direction; the last one stays.
    """
    if points_kernels.are_apart(np.ascontiguousarray(points, dtype=float), SAME):
        return points
    moved = (np.abs(points[1:] - points[:-1]) > SAME).any(axis=1)
    kept: np.ndarray = points[np.concatenate(([True], moved))]
    kept[-1] = points[-1]
    return kept
