"""A robot on paper: drives a controller in a closed loop through obstacles, without physics, planner or ROS."""

from __future__ import annotations

import functools
import math
import weakref
from dataclasses import dataclass, field
from typing import Any, Callable, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid
from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import ControlError
from mbf_relay.planning.path import Path

BURGER = np.array([[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]])

Occupied = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Tells for points x, y (m), of shapes that broadcast, whether an obstacle is there."""

TURTLEBOT3 = dict(
    max_vel_x=0.22, min_vel_x=-0.22, max_vel_y=0.0, min_vel_y=0.0, max_vel_trans=0.22, min_vel_trans=0.11,
    max_vel_theta=2.75, min_vel_theta=1.37, acc_lim_x=2.5, acc_lim_y=0.0, acc_lim_theta=3.2, xy_goal_tolerance=0.05,
    yaw_goal_tolerance=0.17, latch_xy_goal_tolerance=False, sim_time=1.5, vx_samples=20, vy_samples=0, vth_samples=40,
    path_distance_bias=32.0, goal_distance_bias=20.0, occdist_scale=0.02, forward_point_distance=0.325,
    stop_time_buffer=0.2, scaling_speed=0.25, max_scaling_factor=0.2, oscillation_reset_dist=0.05,
)
"""The tutorials' DWA parameters for the burger."""


def nowhere(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return no obstacle anywhere."""
    return np.zeros(np.broadcast(x, y).shape, dtype=bool)


_STANDING: weakref.WeakSet[Occupied] = weakref.WeakSet([nowhere])
"""Obstacles that are the same whenever they are asked for."""


def boxes(*limits: Tuple[float, float, float, float]) -> Occupied:
    """Return obstacles that fill boxes, each x_min, y_min, x_max, y_max in metres."""

    def occupied(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        hit = np.zeros(np.broadcast(x, y).shape, dtype=bool)
        for x_min, y_min, x_max, y_max in limits:
            hit |= ((x >= x_min) & (x <= x_max)) & ((y >= y_min) & (y <= y_max))
        return hit

    _STANDING.add(occupied)
    return occupied


def discs(*circles: Tuple[float, float, float]) -> Occupied:
    """Return round obstacles, each x, y, radius in metres."""

    def occupied(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        hit = np.zeros(np.broadcast(x, y).shape, dtype=bool)
        is_grid = np.ndim(x) == np.ndim(y) == 2 and x.shape[0] == y.shape[1] == 1
        for cx, cy, radius in circles:
            if is_grid:  # most of what the tests would compute are points far from small discs
                columns, rows = _span(x[0], cx, radius), _span(y[:, 0], cy, radius)
                hit[rows, columns] |= (x[:, columns] - cx) ** 2 + (y[rows] - cy) ** 2 <= radius * radius
            else:
                hit |= (x - cx) ** 2 + (y - cy) ** 2 <= radius * radius
        return hit

    _STANDING.add(occupied)
    return occupied


def _span(values: np.ndarray, center: float, radius: float) -> slice:
    """Return the part of rising values that may be within a radius of the centre."""
    margin = radius + 1e-6
    return slice(*np.searchsorted(values, (center - margin, center + margin)))


def costmap_round(
    pose: Pose2D, occupied: Occupied = nowhere, size: float = 3.0, resolution: float = 0.05,
    footprint: np.ndarray = BURGER, inflation: float = 1.0, decay: float = 3.0, now: float = 0.0,
) -> CostGrid:
    """Return a rolling costmap: a cell is lethal where any of 5 x 5 points in it is occupied."""
    cells = int(round(size / resolution))
    grid = Grid(
        resolution, math.floor((pose.x - size / 2.0) / resolution) * resolution,
        math.floor((pose.y - size / 2.0) / resolution) * resolution, cells, cells,
    )
    inscribed = _inscribed_radius(tuple(map(tuple, footprint.tolist())))
    raster = _costs_of_what_stands if occupied in _STANDING else _costs
    costs = raster(occupied, grid, inscribed, inflation, decay).copy()
    circumscribed = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
    return CostGrid(grid, costs, "odom", footprint, inscribed, circumscribed, stamp=now)


def _costs(occupied: Occupied, grid: Grid, inscribed: float, inflation: float, decay: float) -> np.ndarray:
    steps = (np.arange(grid.width * 5) + 0.5) / 5.0 * grid.resolution
    covered = occupied(grid.origin_x + steps[None, :], grid.origin_y + steps[:, None])
    costs = np.zeros(grid.shape, dtype=np.uint8)
    if covered.any():
        # slice by slice, since NumPy reduces short axes slowly, and most of what the tests compute are these costmaps
        rows = functools.reduce(np.logical_or, (covered[offset::5] for offset in range(5)))
        lethal = functools.reduce(np.logical_or, (rows[:, offset::5] for offset in range(5)))
        distance = distances_to_zeros(~lethal) * grid.resolution
        costs = np.where(distance <= inflation, 252.0 * np.exp(-decay * (distance - inscribed)), 0.0)
        costs = np.where(distance <= inscribed, INSCRIBED, np.minimum(costs, INSCRIBED - 1)).astype(np.uint8)
        costs[lethal] = LETHAL
    return np.ascontiguousarray(costs)


_costs_of_what_stands = functools.lru_cache(maxsize=16)(_costs)
"""A robot needs several cycles to its next cell."""


@functools.lru_cache(maxsize=None)
def _inscribed_radius(footprint: Tuple[Tuple[float, float], ...]) -> float:
    starts = np.array(footprint)
    edges = np.roll(starts, -1, axis=0) - starts
    along = np.clip(-(starts * edges).sum(axis=1) / (edges ** 2).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(starts + along[:, None] * edges).T).min())


def path_through(*corners: Sequence[float], spacing: float = 0.025, end_heading: Optional[float] = None) -> Path:
    """Return a path of straight stretches through corners (x, y), its poses heading along it."""
    points: List[np.ndarray] = []
    for start, end in zip(np.array(corners, float)[:-1], np.array(corners, float)[1:]):
        count = max(1, int(np.hypot(*(end - start)) / spacing))
        points.extend(start + (end - start) * i / count for i in range(count))
    points.append(np.array(corners[-1], dtype=float))
    places = np.array(points)
    steps = np.diff(places, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    last = headings[-1] if end_heading is None else end_heading
    return Path(np.column_stack((places, np.append(headings, last))), "odom")


@dataclass
class Drive:
    """What became of a drive.

    Attributes:
        reached: Whether the controller said so.
        error: The error it ended with, or None.
        poses, commands: One row per cycle.
        failed: Whether the controller had no velocity in a cycle, so that the robot was stopped.
        contacts: Cycles in which the footprint touched an obstacle.
        seconds: Time taken.
    """

    reached: bool = False
    error: Optional[ControlError] = None
    poses: List[Pose2D] = field(default_factory=list)
    commands: List[Twist2D] = field(default_factory=list)
    failed: List[bool] = field(default_factory=list)
    contacts: int = 0
    seconds: float = 0.0


class PaperRobot:
    """Moves as commanded, within accelerations of its own."""

    def __init__(self, pose: Pose2D, acceleration: float = 1.0, turn_acceleration: float = 12.0) -> None:
        self.pose, self.velocity = pose, Twist2D(0.0, 0.0, 0.0)
        self._acceleration, self._turn_acceleration = acceleration, turn_acceleration

    def move(self, command: Twist2D, seconds: float, step: float = 0.01) -> None:
        """Drive for a while."""
        change, turn_change = self._acceleration * step, self._turn_acceleration * step
        for _ in range(int(round(seconds / step))):
            if self.velocity != command:
                self.velocity = Twist2D(
                    _toward(self.velocity.x, command.x, change),
                    _toward(self.velocity.y, command.y, change),
                    _toward(self.velocity.theta, command.theta, turn_change),
                )
            x, y, theta = self.velocity
            self.pose = self.pose.compose(Pose2D(x * step, y * step, theta * step))


def _toward(value: float, target: float, change: float) -> float:
    return min(value + change, max(value - change, target))


def touches(pose: Pose2D, occupied: Occupied, footprint: np.ndarray = BURGER, shrink: float = 0.0) -> bool:
    """Return whether the footprint, outline and inside, covers an obstacle."""
    if occupied is nowhere:
        return False
    places = pose.transform_points(_points_within(*footprint.min(axis=0) + shrink, *footprint.max(axis=0) - shrink))
    return bool(occupied(places[:, 0], places[:, 1]).any())


@functools.lru_cache(maxsize=None)
def _points_within(left: float, low: float, right: float, high: float) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(left, right, 16), np.linspace(low, high, 16))
    return np.column_stack((x.ravel(), y.ravel()))


def drive(
    controller: Controller, path: Path, start: Pose2D, occupied: Occupied = nowhere, seconds: float = 60.0,
    period: float = 0.1, robot: Optional[PaperRobot] = None, patience: float = 1.0, costmap: Any = costmap_round,
    each_cycle: Optional[Callable[[float, Pose2D], Optional[Path]]] = None, footprint: np.ndarray = BURGER,
) -> Drive:
    """Drive a path until the goal is reached, the controller has failed for `patience` seconds, or time is up.

    Args:
        controller: Made anew or used before.
        path: The path, in "odom".
        start: Where the robot stands.
        occupied: The obstacles.
        seconds: Time limit.
        period: Seconds per cycle.
        robot: Stands at `start` where given.
        patience: Seconds of errors in a row that end the drive.
        costmap: Makes the costmap: called with pose, obstacles and now=.
        each_cycle: Called with time and pose; may return a new path to the same goal.
        footprint: What touches obstacles; `costmap` has one of its own.
    """
    robot = robot or PaperRobot(start)
    controller.set_path(path, True)
    result, failed_since = Drive(), None
    for cycle in range(int(seconds / period)):
        now = cycle * period
        replanned = each_cycle(now, robot.pose) if each_cycle else None
        if replanned is not None:
            controller.set_path(replanned, False)
        state = ControlState(now, robot.pose, robot.velocity, costmap(robot.pose, occupied, now=now), IDENTITY, period)
        result.seconds = now
        if controller.is_goal_reached(state):
            result.reached = True
            return result
        try:
            command, result.error, failed_since = controller.compute_velocity(state), None, None
        except ControlError as error:
            command, result.error = Twist2D(0.0, 0.0, 0.0), error
            failed_since = now if failed_since is None else failed_since
            if now - failed_since >= patience:
                return result
        robot.move(command, period)
        result.poses.append(robot.pose)
        result.commands.append(command)
        result.failed.append(result.error is not None)
        result.contacts += touches(robot.pose, occupied, footprint)
    return result


def sign_changes(values: Iterable[float], threshold: float = 0.05) -> int:
    """Count the changes of sign among values beyond the threshold."""
    signs = [math.copysign(1.0, value) for value in values if abs(value) > threshold]
    return sum(a != b for a, b in zip(signs, signs[1:]))
