"""The cost to go: how good a place is to be at in a moment, for a robot that finds its way on among what moves."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.control import path_kernels, space_time_kernels
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.local_path import LocalPath
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

LAYER = 0.75  # s from one layer of the grid to the next at most; less where the robot drives its width in less
LAYERS = 8
FIRST = 2  # layers until the moment that places are judged at: till then somebody else says what the robot does
REACH = 2  # cells that the robot drives from layer to layer at its top speed
PRICE = 20.0  # what a second in somebody's way costs, in seconds of driving
BLOCKED = 10.0  # what a second in an obstacle does; finite, for the robot may stand in what seems to be one
STROKE = 0.02  # what a second of driving costs besides: where all is alike, the robot stands


class SpaceTimeCosts:
    """Values of a grid in space and time, from a moment on, by dynamic programming.

    In each layer of time the robot, taken for a disc that goes any way it likes, stands or drives at up to its top
    speed. It pays for being near what moves, and in the end for what is left of its path. So a place counts for what
    can be made of it: one without a way out is as bad as what will happen there, and one where somebody can be let past
    is good. Costs are in seconds of driving.

    Source: Fraichard, Asama, "Inevitable collision states: a step towards safer robots?" (2004), for what a place is
    worth; Silver, "Cooperative pathfinding" (2005), for a window of space and time.

    Attributes:
        moment: Seconds from now at which places are judged.
        is_clear: Whether nobody comes near any place at which the robot can be by then, till the last layer.
    """

    def __init__(
        self, foresight: Foresight, checker: FootprintChecker, pose: Pose2D, path: LocalPath, speed: float
    ) -> None:
        """Look ahead.

        Args:
            foresight: What moves.
            checker: What stands.
            pose: The robot now.
            path: Where it wants to go.
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
        radius = 0.5 * (0.5 * width + math.hypot(0.5 * (front - back), 0.5 * width))  # between its inner and outer one
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
        """Return the cost from each pose on, shape (N, 3), at the moment: between cells by bilinear interpolation."""
        x, y, theta = np.ascontiguousarray(poses.T)
        x, y = x + self._ahead * np.cos(theta) - self._x, y + self._ahead * np.sin(theta) - self._y
        farthest = REACH * FIRST + 1.0  # cells; it is at most as far away, give or take what it was faster before
        across, up = (self._half + np.clip(off / self._cell, -farthest, farthest) for off in (x, y))
        column, row = across.astype(int), up.astype(int)
        a, b, costs = across - column, up - row, self._costs
        found: np.ndarray = (
            (1.0 - b) * ((1.0 - a) * costs[row, column] + a * costs[row, column + 1])
            + b * ((1.0 - a) * costs[row + 1, column] + a * costs[row + 1, column + 1])
        )
        return found


def _left(path: LocalPath, points: np.ndarray, spacing: float) -> np.ndarray:
    """Return how far (m) it is from points, (M, 2), to the path and along it to the goal, shape (M,).

    The path is thinned to about `spacing` (m).
    """
    length = max(1e-9, float(path.arcs[-1] - path.arcs[0]))
    every = max(1, int(spacing * (len(path.arcs) - 1) / length))
    kept = np.append(np.arange(0, len(path.arcs) - 1, every), len(path.arcs) - 1)
    found = np.empty((len(points), 2))
    path_kernels.project(points, path.points[kept], path.arcs[kept], found)
    left: np.ndarray = np.maximum(0.0, path.goal_arc - found[:, 1]) + found[:, 0]
    return left


def _is_blocked(checker: FootprintChecker, points: np.ndarray) -> np.ndarray:
    """Return at which points, (M, 2), the robot would stand in an obstacle, shape (M,); what is not known is free."""
    grid = checker.costmap.grid
    columns, rows = (points[:, 0] - grid.origin_x) / grid.resolution, (points[:, 1] - grid.origin_y) / grid.resolution
    is_known = (columns >= 0.0) & (columns < grid.width) & (rows >= 0.0) & (rows < grid.height)
    blocked: np.ndarray = is_known & (checker.clearances_at(points) < checker.costmap.half_width)
    return blocked
