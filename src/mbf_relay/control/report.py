"""What a controller shows of a cycle to whoever watches it."""

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
        costmap: What the robot saw.
        path: The path round the robot.
        trajectory: Shape (S, 3): where the command would lead; empty where the robot only turns or stands.
        trajectories: The batch it was chosen from, where there was one.
        totals: Shape (N,): their costs; inf for those ruled out.
        explanation: Why; as a text, one line for a person. None where there is nothing to say.
        shows_trajectories: Whether the user wants the batch published.
        cost_weights: What the three `cell_costs` weigh, where the user wants them published; None where not.
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
        """Return the path from the robot on, within the costmap: (K, 3) poses."""
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
        """Return the free cells' centres, (M, 2) in metres, and what being there costs: (M, 3).

        The three are metres to the path, metres of path left, and the costmap's cost.
        """
        grid: Grid = self.costmap.grid
        rows, columns = np.nonzero(self.costmap.costs < INSCRIBED)
        centers = grid.centers_of(np.column_stack((columns, rows)))
        measured = self.path.project(centers, self.path.robot_arc, float(self.path.arcs[-1]))
        left = np.maximum(0.0, self.path.arcs[-1] - measured[:, 1])
        return centers, np.column_stack((measured[:, 0], left, self.costmap.costs[rows, columns]))
