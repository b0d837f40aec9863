"""The local part of the global plan: smoothed, cut out round the robot, in the costmap's frame, with arc lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, NamedTuple, Optional

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import FARTHEST, Pose2D
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.planning.path import Path

SPACING = 0.4  # cells between points of the path; planners' poses may lie closer than a controller can use
SMOOTHING = 2.4  # cells over which a path is averaged, which removes the staircase of grid planners
LONGEST = 1e5  # m: longest path that is followed
MOST_POINTS = 5_000_000  # points kept of a path; the spacing grows where there would be more

# in robot's widths
NEARBY = 1.0  # distance from the path up to which the robot's place on it is looked for near the last one only
FORWARD = 4.5  # how far ahead of the last place it is looked for then
ARRIVAL = 0.65  # last part of the path, whose direction the extension beyond the goal takes
FOLD_LEG = 0.5  # distance before and after a point by which a fold is detected there

FOLD = -0.7  # cosine of the turn there (inner product over FOLD_LEG squared) below which it is one: above 135 degrees


@dataclass(frozen=True)
class LocalPath:
    """The path near the robot up to the goal, or up to the next fold, which takes the goal's place until it is reached.

    A fold is a point where the path turns back on itself. Near it both legs are near the robot, and a controller that
    saw both would stop between them.

    Attributes:
        points: Shape (K, 2), K >= 2, metres in the costmap's frame; extended straight beyond the goal.
        arcs: Shape (K,): arc length (m) of each point, from the beginning of the whole path.
        robot_arc: Arc length (m) of the point nearest to the robot.
        robot_distance: Distance (m) from the robot to that point.
        goal_arc: Arc length (m) of the goal.
        goal: The goal's pose in the costmap's frame.
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
        """Return the point (2,) at an arc length (m), clipped to this part of the path."""
        return np.array([path_kernels.interpolate(arc, self.arcs, self.points, axis) for axis in (0, 1)])

    def project(self, points: np.ndarray, start: float, end: float) -> np.ndarray:
        """Return each point's distance to the path and the arc length nearest to it.

        Args:
            points: Shape (M, 2) in metres.
            start, end: Arc lengths (m) between which the path counts.

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
        """Return the arc length (m) of the first point ahead where the robot's centre cannot be; None for none.

        The part from where the path leaves the costmap counts as free.
        """
        ahead = np.flatnonzero((self.arcs >= self.robot_arc) & (self.arcs <= self.goal_arc))
        for index in ahead:
            if not checker.costmap.grid.contains_point(*self.points[index]):
                return None
            if checker.clearance_at(*self.points[index]) < checker.costmap.inscribed_radius:
                return float(self.arcs[index])
        return None


class _Leg(NamedTuple):
    """The indices of a path's points from one fold to the next, and the pose it ends at."""

    part: slice
    goal: Pose2D


class PathTracker:
    """Holds a path and tracks the robot's progress along it.

    A path that turns back on itself is split into legs at its folds, and only the leg that the robot is on counts, as
    with Nav2's `enforce_path_inversion`.
    """

    def __init__(self) -> None:
        self.path: Optional[Path] = None
        self._points = np.zeros((0, 2))
        self._arcs = np.zeros(0)
        self._legs: List[_Leg] = []
        self._leg = 0  # index of the one the robot is on
        self._robot_arc = 0.0
        self._spacing = 0.0  # m between points; 0 before _prepare
        self._length = 0.0  # m, of the path as given

    def set_path(self, path: Path) -> None:
        """Follow another path; the robot's place on it is looked for from its beginning.

        So a closed path is driven, not ended where it begins.

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
        self._robot_arc, self._legs, self._leg = 0.0, [], 0

    @property
    def is_on_last_leg(self) -> bool:
        """Whether no fold of the path lies ahead."""
        return self._leg >= len(self._legs) - 1

    def cut(
        self, state: ControlState, behind: float, ahead: float, extension: float, tolerance: float = 0.0
    ) -> LocalPath:
        """Return the part of the path near the robot; beyond the path's end, the straight line back to the goal.

        Args:
            state: Gives the robot's pose and the transform to the costmap's frame.
            behind, ahead: Path (m) before and after the robot's place on it.
            extension: Length (m) of the straight extension beyond the goal.
            tolerance: Distance (m) along the path from which on a fold counts as reached.
        """
        robot, width = state.pose.relative_to(state.costmap_from_path), state.costmap.width
        distance, arc = self._locate(state, robot)
        if not self.is_on_last_leg and self._arcs[self._legs[self._leg].part][-1] - arc <= tolerance:
            self._leg += 1
            distance, arc = self._locate(state, robot)
        leg = self._legs[self._leg]
        points, arcs = self._points[leg.part], self._arcs[leg.part]
        goal_arc = float(arcs[-1])
        if arc >= self._arcs[-1] and distance > self._spacing:
            points, arcs = self._way_back(robot, distance)
            arc = float(arcs[0])
        else:
            first = max(0, int(arcs.searchsorted(arc - behind)) - 1)
            last = min(len(arcs), int(arcs.searchsorted(arc + ahead)) + 1)
            points, arcs = points[first:last], arcs[first:last]
        if arcs[-1] == goal_arc:
            points, arcs = self._extended(points, arcs, robot, extension, width)
        return LocalPath(
            np.ascontiguousarray(state.costmap_from_path.transform_points(points)), np.ascontiguousarray(arcs), arc,
            distance, goal_arc, state.costmap_from_path.compose(leg.goal),
        )

    def _prepare(self, spacing: float, width: float) -> None:
        """Thin, split into legs and smooth the path, once per path and `spacing` (m); `width` (m) is the robot's."""
        if self._spacing == spacing:
            return
        self._spacing = spacing
        assert self.path is not None
        poses = np.asarray(self.path.poses, dtype=float)
        spacing = max(spacing, self._length / MOST_POINTS)
        kept = _thinned(poses, spacing)
        points = np.ascontiguousarray(poses[kept, :2])
        folds = _folds(points, FOLD_LEG * width)
        pieces = [
            _smoothed(points[first:last + 1], spacing) for first, last in zip([0, *folds], [*folds, len(points) - 1])]
        self._points = np.concatenate(pieces)
        self._arcs = _arcs_along(self._points)
        ends = np.cumsum([len(piece) for piece in pieces]).tolist()
        # a fold's own heading may be that of the next leg: take the heading of the pose before it
        goals = [Pose2D(*[*points[fold].tolist(), float(poses[kept[fold] - 1, 2])]) for fold in folds]
        self._legs = [_Leg(slice(*part), goal) for part, goal in zip(zip([0, *ends], ends), [*goals, self.path.goal])]
        self._leg = min(self._leg, len(self._legs) - 1)  # on a coarser grid, fewer folds may be detected

    def remaining(self, state: ControlState) -> float:
        """Return the length (m) of the whole path left from the robot's place on it."""
        _distance, arc = self._locate(state, state.pose.relative_to(state.costmap_from_path))
        return float(self._arcs[-1]) - arc

    def _locate(self, state: ControlState, robot: Pose2D) -> tuple[float, float]:
        """Return distance (m) to and arc length (m) of the robot's place on the path.

        It is looked for near the last place; if the path is farther than NEARBY there, on all of the leg; and on other
        legs, if these are nearer by NEARBY.
        """
        width = state.costmap.width
        self._prepare(SPACING * state.costmap.grid.resolution, width)
        place, near, part = np.array([[robot.x, robot.y]]), NEARBY * width, self._legs[self._leg].part
        distance, arc = self._nearest(place, part, self._robot_arc - near, self._robot_arc + FORWARD * width)
        if distance >= near:
            distance, arc = self._nearest(place, part)
            found, elsewhere = self._nearest(place, slice(None)) if len(self._legs) > 1 else (distance, arc)
            if found < distance - near:
                distance, arc = found, elsewhere
                self._leg = int(np.searchsorted([self._arcs[leg.part][-1] for leg in self._legs], arc))
        self._robot_arc = arc
        return distance, arc

    def _nearest(
        self, place: np.ndarray, part: slice, start: float = 0.0, end: float = math.inf
    ) -> tuple[float, float]:
        """Return distance to and arc length of the point nearest to `place`, (1, 2), between arc lengths (m)."""
        points, arcs = self._points[part], self._arcs[part]
        if len(points) == 1:
            return float(np.hypot(*(place[0] - points[0]))), 0.0
        first = max(0, min(int(arcs.searchsorted(start)) - 1, len(arcs) - 2))
        last = max(first + 2, min(len(arcs), int(arcs.searchsorted(end)) + 1))
        result = np.empty((1, 2))
        path_kernels.project(place, points[first:last], arcs[first:last], result)
        return float(result[0, 0]), float(result[0, 1])

    def _way_back(self, robot: Pose2D, distance: float) -> tuple[np.ndarray, np.ndarray]:
        """Return points and arc lengths of the straight line from a robot beyond the path's end back to the goal."""
        shares = np.linspace(0.0, 1.0, 2 + int(distance / self._spacing))
        place = np.array([robot.x, robot.y])
        points = place + shares[:, np.newaxis] * (self._points[-1] - place)
        return points, self._arcs[-1] + distance * (shares - 1.0)

    def _extended(
        self, points: np.ndarray, arcs: np.ndarray, robot: Pose2D, extension: float, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Extend the path beyond the goal in the direction of its end; if that is too short, away from the robot."""
        start, end = points[max(0, int(arcs.searchsorted(arcs[-1] - ARRIVAL * width)))], points[-1]
        direction = end - start
        if np.hypot(*direction) < 0.7 * ARRIVAL * width:
            direction = end - (robot.x, robot.y)
        length = float(np.hypot(*direction))
        if length < 1e-6:
            direction, length = np.array([math.cos(robot.theta), math.sin(robot.theta)]), 1.0
        extension = max(extension, self._spacing)
        beyond = end + direction * (extension / length)
        return np.vstack((points, beyond)), np.append(arcs, arcs[-1] + extension)


def _thinned(poses: np.ndarray, spacing: float) -> np.ndarray:
    """Return the indices of poses at least `spacing` (m) apart, the last one included."""
    keep = np.empty(len(poses), dtype=np.uint8)
    path_kernels.thin(np.ascontiguousarray(poses[:, :2]), spacing, keep)
    return np.flatnonzero(keep)


def _folds(points: np.ndarray, leg: float) -> List[int]:
    """Return the indices of the folds of a path of points (N, 2); none within `leg` (m) of its ends."""
    arcs, inner, products = _arcs_along(points), np.empty(len(points), np.int64), np.empty(len(points))
    count = path_kernels.compare_legs(points, arcs, leg, inner, products)
    inner, products = inner[:count], products[:count] / (leg * leg)
    sharp = np.flatnonzero(products < FOLD)
    if not len(sharp):
        return []
    runs = np.split(sharp, np.flatnonzero(np.diff(arcs[inner[sharp]]) > 0.5 * leg) + 1)  # of one fold each
    return [int(inner[run[np.argmin(products[run])]]) for run in runs if len(run)]


def _smoothed(points: np.ndarray, spacing: float) -> np.ndarray:
    """Return a path resampled at `spacing` (m) and averaged over SMOOTHING; a short path as it is.

    Its ends stay; it passes a right-angled corner within a third of SMOOTHING.
    """
    arcs = _arcs_along(points)
    smooth = np.empty((int(arcs[-1] / spacing) + 1, 2))
    count = path_kernels.smooth(points, arcs, spacing, max(1, round(0.5 * SMOOTHING / SPACING)), smooth)
    return smooth if count else points


def _arcs_along(points: np.ndarray) -> np.ndarray:
    arcs = np.empty(len(points))
    path_kernels.measure(points, arcs)
    return arcs
