"""The stretch of the path a controller looks at: cut out round the robot, in the costmap's frame, with arc lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import FARTHEST, Pose2D
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.planning.path import Path

SPACING = 0.4  # cells between the points kept of a path; planners put them closer than a controller can use
SMOOTHING = 2.4  # cells over which a path is averaged, which takes the steps from cell to cell out of it
LONGEST = 1e5  # m of path, beyond which nothing is followed
MOST_POINTS = 5_000_000  # kept of a path, however long it is and fine the grid

# in robot's widths
NEARBY = 1.0  # the robot's place on the path is looked for near the last one while it is no farther away
FORWARD = 4.5  # how far along the path it is looked for
ARRIVAL = 0.65  # the end of the path whose direction it goes on in beyond the goal


@dataclass(frozen=True)
class LocalPath:
    """What lies ahead.

    Attributes:
        points: Shape (K, 2), K >= 2, metres in the costmap's frame; it goes on straight beyond the goal.
        arcs: Shape (K,), metres along the whole path.
        robot_arc: Arc length of the point nearest to the robot.
        robot_distance: Distance (m) from the robot to that point.
        goal_arc: Arc length of the goal.
        goal: The goal in the costmap's frame.
    """

    points: np.ndarray
    arcs: np.ndarray
    robot_arc: float
    robot_distance: float
    goal_arc: float
    goal: Pose2D

    @property
    def remaining(self) -> float:
        """Distance (m) along the path from the robot to the goal."""
        return max(0.0, self.goal_arc - self.robot_arc)

    def point_at(self, arc: float) -> np.ndarray:
        """Return the point (2,) at an arc length, clipped to this stretch."""
        return np.array([path_kernels.interpolate(arc, self.arcs, self.points, axis) for axis in (0, 1)])

    def project(self, points: np.ndarray, start: float, end: float) -> np.ndarray:
        """Return each point's distance to the path and the arc length nearest to it.

        Args:
            points: Shape (M, 2) in metres.
            start, end: Only the path between these arc lengths counts.

        Returns:
            Shape (M, 2): distance and arc length, both in metres.
        """
        first = max(0, int(self.arcs.searchsorted(start)) - 1)
        last = min(len(self.arcs), int(self.arcs.searchsorted(end)) + 1)
        if last - first < 2:
            first, last = max(0, last - 2), max(2, last)
        result = np.empty((len(points), 2))
        path_kernels.project(
            np.ascontiguousarray(points[:, :2]), self.points[first:last], self.arcs[first:last], result
        )
        return result

    def first_blocked(self, checker: FootprintChecker) -> Optional[float]:
        """Return the arc length ahead at which the robot's centre could not be, None where the stretch is free.

        Of what lies beyond the costmap nothing is known here.
        """
        ahead = np.flatnonzero((self.arcs >= self.robot_arc) & (self.arcs <= self.goal_arc))
        for index in ahead:
            if not checker.costmap.grid.contains_point(*self.points[index]):
                return None
            if checker.clearance_at(*self.points[index]) < checker.costmap.inscribed_radius:
                return float(self.arcs[index])
        return None


class PathTracker:
    """Holds a path and knows how far along it the robot is."""

    def __init__(self) -> None:
        self.path: Optional[Path] = None
        self._points = np.zeros((0, 2))
        self._arcs = np.zeros(0)
        self._robot_arc = 0.0
        self._spacing = 0.0  # m between the points; 0 where they are still to be made
        self._length = 0.0  # m along the path as it was given

    def set_path(self, path: Path) -> None:
        """Follow another path; the robot's place on it is found anew, at its beginning where it may be that.

        A path that comes back to where it began is driven, not ended there.

        Raises:
            ControlError: INVALID_PATH; the path is empty or longer than LONGEST, or a pose is not finite or beyond
                FARTHEST.
        """
        poses = np.asarray(path.poses, dtype=float)
        if poses.ndim != 2 or len(poses) == 0:
            raise ControlError(ControlOutcome.INVALID_PATH, "the path is empty; it must have at least one pose")
        if not np.isfinite(poses).all():
            broken = np.flatnonzero(~np.isfinite(poses).all(axis=1))
            raise ControlError(
                ControlOutcome.INVALID_PATH,
                f"pose {broken[0]} of the path is {tuple(poses[broken[0]])}; every number must be finite",
            )
        far = np.flatnonzero((np.abs(poses[:, :2]) > FARTHEST).any(axis=1))
        if len(far) > 0:
            raise ControlError(
                ControlOutcome.INVALID_PATH,
                f"pose {far[0]} of the path is {tuple(poses[far[0]])}; "
                f"a place must be within {FARTHEST / 1e3:g} km of its frame's origin",
            )
        self._length = float(_arcs_along(np.ascontiguousarray(poses[:, :2]))[-1])
        if self._length > LONGEST:
            raise ControlError(
                ControlOutcome.INVALID_PATH,
                f"the path is {self._length / 1e3:.0f} km long; at most {LONGEST / 1e3:g} km can be followed",
            )
        self.path = path
        self._spacing = 0.0
        self._robot_arc = 0.0

    def cut(self, state: ControlState, behind: float, ahead: float, extension: float) -> LocalPath:
        """Return the stretch round the robot; for one beyond the end of the path, the straight way back to the goal.

        Args:
            state: Where the robot is.
            behind, ahead: How far (m) it reaches from the robot's place on the path.
            extension: How far (m) it goes on beyond the goal, straight.
        """
        robot, width = state.pose.relative_to(state.costmap_from_path), state.costmap.width
        distance, arc = self._locate(state, robot)
        if arc >= self._arcs[-1] and distance > self._spacing:
            points, arcs = self._way_back(robot, distance)
            arc = float(arcs[0])
        else:
            first = max(0, int(self._arcs.searchsorted(arc - behind)) - 1)
            last = min(len(self._arcs), int(self._arcs.searchsorted(arc + ahead)) + 1)
            points, arcs = self._points[first:last], self._arcs[first:last]
        assert self.path is not None
        if arcs[-1] == self._arcs[-1]:
            points, arcs = self._extended(points, arcs, robot, extension, width)
        return LocalPath(
            np.ascontiguousarray(state.costmap_from_path.transform_points(points)), np.ascontiguousarray(arcs), arc,
            distance, float(self._arcs[-1]), state.costmap_from_path.compose(self.path.goal),
        )

    def _prepare(self, spacing: float) -> None:
        """Thin and smooth a new path for a grid; `spacing` is in metres."""
        if self._spacing == spacing:
            return
        self._spacing = spacing
        assert self.path is not None
        poses = np.asarray(self.path.poses, dtype=float)
        self._points, self._arcs = _thin(poses, max(spacing, self._length / MOST_POINTS))

    def remaining(self, state: ControlState) -> float:
        """Return how much (m) of the path is left from the robot's place on it."""
        _distance, arc = self._locate(state, state.pose.relative_to(state.costmap_from_path))
        return float(self._arcs[-1]) - arc

    def _locate(self, state: ControlState, robot: Pose2D) -> tuple[float, float]:
        """Return distance to and arc length of the robot's place: near the last one, or wherever that is far off."""
        self._prepare(SPACING * state.costmap.grid.resolution)
        place, width = np.array([[robot.x, robot.y]]), state.costmap.width
        distance, arc = self._nearest(place, self._robot_arc - NEARBY * width, self._robot_arc + FORWARD * width)
        if distance >= NEARBY * width:
            distance, arc = self._nearest(place, 0.0, math.inf)
        self._robot_arc = arc
        return distance, arc

    def _nearest(self, place: np.ndarray, start: float, end: float) -> tuple[float, float]:
        if len(self._points) == 1:
            return float(np.hypot(*(place[0] - self._points[0]))), 0.0
        first = max(0, int(self._arcs.searchsorted(start)) - 1)
        last = max(first + 2, min(len(self._arcs), int(self._arcs.searchsorted(end)) + 1))
        result = np.empty((1, 2))
        path_kernels.project(place, self._points[first:last], self._arcs[first:last], result)
        return float(result[0, 0]), float(result[0, 1])

    def _way_back(self, robot: Pose2D, distance: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the straight line to the goal of a robot that is `distance` (m) beyond it or beside."""
        shares = np.linspace(0.0, 1.0, 2 + int(distance / self._spacing))
        place = np.array([robot.x, robot.y])
        points = place + shares[:, np.newaxis] * (self._points[-1] - place)
        return points, self._arcs[-1] + distance * (shares - 1.0)

    def _extended(
        self, points: np.ndarray, arcs: np.ndarray, robot: Pose2D, extension: float, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lengthen a stretch beyond the goal the way the path arrives there, or from the robot where it is too short.
        """
        start = points[max(0, int(arcs.searchsorted(arcs[-1] - ARRIVAL * width)))]
        direction = self._points[-1] - start
        if np.hypot(*direction) < 0.7 * ARRIVAL * width:
            direction = self._points[-1] - (robot.x, robot.y)
        length = float(np.hypot(*direction))
        if length < 1e-6:
            direction, length = np.array([math.cos(robot.theta), math.sin(robot.theta)]), 1.0
        extension = max(extension, self._spacing)
        beyond = self._points[-1] + direction * (extension / length)
        return np.vstack((points, beyond)), np.append(arcs, self._arcs[-1] + extension)


def _thin(poses: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions at least `spacing` (m) apart, the last one kept, and their arc lengths."""
    points = np.ascontiguousarray(poses[:, :2])
    keep = np.empty(len(points), dtype=np.uint8)
    path_kernels.thin(points, spacing, keep)
    points = _smoothed(points[keep.view(bool)], spacing)
    return points, _arcs_along(points)


def _smoothed(points: np.ndarray, spacing: float) -> np.ndarray:
    """Return a path resampled at `spacing` (m) and averaged over SMOOTHING.

    Its ends stay; at a right angle it passes the corner within a third of SMOOTHING.
    """
    arcs = _arcs_along(points)
    smooth = np.empty((int(arcs[-1] / spacing) + 1, 2))
    count = path_kernels.smooth(points, arcs, spacing, max(1, round(0.5 * SMOOTHING / SPACING)), smooth)
    return smooth if count else points


def _arcs_along(points: np.ndarray) -> np.ndarray:
    arcs = np.empty(len(points))
    path_kernels.measure(points, arcs)
    return arcs
