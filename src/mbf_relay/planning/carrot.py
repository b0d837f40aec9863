"""The carrot planner: a straight line towards the goal, up to where the footprint fits (carrot_planner)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning import request
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner


@dataclass(frozen=True)
class CarrotParameters(ParameterSet):
    """Parameters of CarrotPlanner, by carrot_planner's names."""

    step_size: float = parameter(
        0.0, "distance between the points tried from the goal back to the robot; 0 for the costmap's resolution",
        unit="m", minimum=0.0)
    min_dist_from_robot: float = parameter(
        0.1, "points nearer to the robot than this are not used as goals", unit="m", minimum=0.0)


class CarrotPlanner(Planner):
    """Plans the straight line to the goal, ending at the point nearest to the goal where the footprint is free.

    As in carrot_planner the line itself may cross obstacles, which are left to the local planner.

    Source: carrot_planner/CarrotPlanner.
    """

    Parameters = CarrotParameters
    parameters: CarrotParameters

    def plan(
        self, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
    ) -> Path:
        request.require_finite(start, goal)
        request.start_cell(costmap, start)  # raises for one that is off the map
        grid = costmap.grid
        distance = start.distance_to(goal)
        step = self.parameters.step_size or grid.resolution
        nearest = min(distance, self.parameters.min_dist_from_robot)  # the goal itself is always tried
        reach = math.hypot(grid.width, grid.height) * grid.resolution + costmap.width  # m, to the farthest cell
        beyond = max(0, math.ceil((distance - reach) / step))  # points not tried: a goal may be 10000 km away
        tried = np.arange(distance - beyond * step, nearest - 1e-9, -step)
        heading = math.atan2(goal.y - start.y, goal.x - start.x)
        line = np.column_stack((
            start.x + tried * math.cos(heading), start.y + tried * math.sin(heading), np.full(len(tried), goal.theta)))
        free = np.flatnonzero(_lies_within(costmap, line) & ~FootprintChecker(costmap).touches(line))
        if len(free) == 0:
            raise PlanningError(
                PlanOutcome.NO_PATH_FOUND,
                f"the robot's footprint is free nowhere on the line from ({start.x:.2f}, {start.y:.2f}) "
                f"to ({goal.x:.2f}, {goal.y:.2f}) in {costmap.frame}")
        way = float(tried[free[0]])
        ways = np.linspace(0.0, way, max(2, int(way / grid.resolution) + 1))
        poses = np.column_stack((
            start.x + ways * math.cos(heading), start.y + ways * math.sin(heading), np.full(len(ways), heading)))
        poses[-1, 2] = goal.theta
        return Path(poses, costmap.frame, way)


def _lies_within(costmap: CostGrid, poses: np.ndarray) -> np.ndarray:
    """Return which poses, (N, 3), lie in the costmap: (N,), bool."""
    grid = costmap.grid
    columns, rows = (poses[:, 0] - grid.origin_x) / grid.resolution, (poses[:, 1] - grid.origin_y) / grid.resolution
    return (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
