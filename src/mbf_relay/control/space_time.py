"""The cost to go of places at a time shortly ahead, among moving obstacles, by dynamic programming."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.control import path_kernels, space_time_kernels
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.local_path import LocalPath
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

LAYER = 0.75  # s between layers of the grid, less where the robot drives its width in less
LAYERS = 8  # layers of the grid
FIRST = 2  # layers from now to the moment at which places are judged; until then Evasion simulates the robot
REACH = 2  # cells that the robot drives between two layers at its top speed
PRICE = 20.0  # cost of a second of contact with a track, in seconds of driving
BLOCKED = 10.0  # cost of a second in an obstacle; finite, because the robot may stand in a wrongly marked one
STROKE = 0.02  # further cost of a second of driving, by which the robot stands where all else is equal


class SpaceTimeCosts:
    """Cost to go over a grid in space and time, by dynamic programming backwards in time.

    Between layers of time the robot, taken as a disc that moves in any direction, stands or drives at up to its top
    speed. It pays for being near tracks, and at the end for the path left. So a place counts by the best that is
    possible from it: one without a way out costs what will happen there, one where somebody can pass costs little.
    Costs are in seconds of driving.

    Source: Fraichard, Asama, "Inevitable collision states: a step towards safer robots?" (2004), for the value of
    places; Silver, "Cooperative pathfinding" (2005), for the window of space and time.

    Attributes:
        moment: Time (s) from now at which places are judged.
        is_clear: Whether up to the last layer no track comes near any place that the robot can reach by then.
    """

    def __init__(
        self, foresight: Foresight, checker: FootprintChecker, pose: Pose2D, path: LocalPath, speed: float
    ) -> None:
        """Compute the costs.

        Args:
            foresight: The predicted tracks.
            checker: The static obstacles.
            pose: The robot's present pose.
            path: The path to follow.
            speed: Top speed (m/s), above zero.
        """
        width, outline = checker.costmap.width, foresight.outline
        layer = min(LAYER, width / speed)
        self.moment = FIRST * layer
        self._cell = speed * layer / REACH
        self._half = REACH * (LAYERS + FIRST)
        front, back = float(outline[:, 0].max()), float(outline[:, 0].min())
        self._ahead = 0.5 * (front + back)
        self._x = pose.x + self._ahead * math.cos(pose.theta)
        self._y = pose.y + self._ahead * math.sin(pose.theta)
        side = 2 * self._half + 1
        places = self._cell * np.arange(-self._half, self._half + 1)
        points = np.column_stack((np.tile(self._x + places, side), np.repeat(self._y + places, side)))
        dangers = np.empty((LAYERS, side, side))
        radius = 0.5 * (0.5 * width + math.hypot(0.5 * (front - back), 0.5 * width))  # mean of inner and outer
        foresight.lay(self._x, self._y, self._cell, layer, radius, dangers)
        self.is_clear = not any(
            layer[self._half - reach : self._half + reach + 1, self._half - reach : self._half + reach + 1].any()
            for reach, layer in zip(range(REACH, self._half, REACH), dangers)
        )
        left = _left(path, points, self._cell).reshape(side, side) / speed
        standing = BLOCKED * layer * _is_blocked(checker, points).reshape(side, side)
        self._costs = np.empty((side, side))
        space_time_kernels.look_back(
            dangers, standing, left, PRICE * layer, STROKE * layer / REACH, FIRST - 1, REACH, self._costs)

    def at(self, poses: np.ndarray) -> np.ndarray:
        """Return the cost to go (s) from poses (N, 3) at `moment`, shape (N,), by bilinear interpolation."""
        x, y, theta = np.ascontiguousarray(poses.T)
        x, y = x + self._ahead * np.cos(theta) - self._x, y + self._ahead * np.sin(theta) - self._y
        farthest = REACH * FIRST + 1.0  # cells: the reach till then, and one
        across, up = (self._half + np.clip(off / self._cell, -farthest, farthest) for off in (x, y))
        column, row = across.astype(int), up.astype(int)
        a, b, costs = across - column, up - row, self._costs
        found: np.ndarray = (
            (1.0 - b) * ((1.0 - a) * costs[row, column] + a * costs[row, column + 1])
            + b * ((1.0 - a) * costs[row + 1, column] + a * costs[row + 1, column + 1])
        )
        return found


def _left(path: LocalPath, points: np.ndarray, spacing: float) -> np.ndarray:
    """Return the distance (m) from points, (M, 2), to the path and on along it to the goal, shape (M,).

    The path is thinned to a spacing of about `spacing` (m).
    """
    length = max(1e-9, float(path.arcs[-1] - path.arcs[0]))
    every = max(1, int(spacing * (len(path.arcs) - 1) / length))
    kept = np.append(np.arange(0, len(path.arcs) - 1, every), len(path.arcs) - 1)
    found = np.empty((len(points), 2))
    path_kernels.project(points, path.points[kept], path.arcs[kept], found)
    left: np.ndarray = np.maximum(0.0, path.goal_arc - found[:, 1]) + found[:, 0]
    return left


def _is_blocked(checker: FootprintChecker, points: np.ndarray) -> np.ndarray:
    """Return at which points, (M, 2), the robot's sides touch an obstacle, bool (M,); outside the costmap: free."""
    grid = checker.costmap.grid
    columns, rows = (points[:, 0] - grid.origin_x) / grid.resolution, (points[:, 1] - grid.origin_y) / grid.resolution
    is_known = (columns >= 0.0) & (columns < grid.width) & (rows >= 0.0) & (rows < grid.height)
    blocked: np.ndarray = is_known & (checker.clearances_at(points) < checker.costmap.half_width)
    return blocked
