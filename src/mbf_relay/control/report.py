"""The report of a control cycle, for topics and displays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.control.explanation import Explanation
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.trajectories import Trajectories
from mbf_relay.costmap.cost_grid import INSCRIBED, CostGrid
from mbf_relay.grid import Grid


@dataclass(frozen=True)
class CycleReport:
    """One cycle, in the costmap's frame.

    Attributes:
        now: Time (s).
        costmap: The local costmap.
        path: The part of the path near the robot.
        trajectory: Shape (S, 3): poses along the command's trajectory; empty where the robot turns, stands or backs
            out.
        trajectories: The batch it was chosen from, None where there was none.
        totals: Shape (N,): their total costs; inf for those ruled out.
        explanation: Why it was chosen; str() gives one line for a log. None where nothing was scored.
        shows_trajectories: Whether the parameters ask for the batch to be published.
        cost_weights: Weights of the three `cell_costs`, where the parameters ask for those to be published; else None.
    """

    now: float
    costmap: CostGrid
    path: LocalPath
    trajectory: np.ndarray
    trajectories: Optional[Trajectories] = None
    totals: Optional[np.ndarray] = None
    explanation: Optional[Explanation] = None
    shows_trajectories: bool = False
    cost_weights: Optional[Tuple[float, float, float]] = None

    def path_ahead(self) -> np.ndarray:
        """Return the path from the robot to where it leaves the costmap, poses of shape (K, 3)."""
        ahead = (self.path.arcs >= self.path.robot_arc) & (self.path.arcs <= self.path.goal_arc)
        points = self.path.points[ahead]
        inside = self.costmap.grid.contains_cells(self.costmap.grid.cells_at(points))
        points = points[: int(np.argmin(inside))] if not inside.all() else points
        if len(points) < 2:
            return np.zeros((0, 3))
        steps_x, steps_y = np.diff(points, axis=0).T.copy()
        headings = np.arctan2(steps_y, steps_x)
        return np.column_stack((points, np.append(headings, headings[-1])))

    def cell_costs(self) -> Tuple[np.ndarray, np.ndarray]:
        """Return the centres of free cells, (M, 2) in metres, and their costs, (M, 3).

        These are distance to the path (m), path left from there to its end (m), and the costmap's cost.
        """
        grid: Grid = self.costmap.grid
        rows, columns = np.nonzero(self.costmap.costs < INSCRIBED)
        centers = grid.centers_of(np.column_stack((columns, rows)))
        measured = self.path.project(centers, self.path.robot_arc, float(self.path.arcs[-1]))
        left = np.maximum(0.0, self.path.arcs[-1] - measured[:, 1])
        return centers, np.column_stack((measured[:, 0], left, self.costmap.costs[rows, columns]))
