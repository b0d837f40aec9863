"""Backing out: a short, slow drive, mostly backwards, out of a place where a robot can neither drive on nor turn."""

from __future__ import annotations

import math
from typing import NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.multi_point_turn import multi_point_turn
from mbf_relay.control.state import SpeedLimit
from mbf_relay.control.trail import Trail
from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D, angle_between, normalize_angles

PATIENCE = 0.25  # s for which driving must have failed before it begins
ASKEW = 0.5  # rad: least heading error; a robot that faces along its path gains nothing by backing out to turn
TRIES = 4  # attempts without progress, after which the controller fails and recovery behaviours follow
SPEED, SLOWEST = 0.45, 0.15  # shares of the top speed

# in robot's widths
REACH = 1.5  # longest arc
LEAST = 0.13  # shortest, and spacing of the ends considered
PROGRESS = 1.3  # decrease of the path left, compared with the least so far, that resets the number of tries
ANOTHER_WAY = 2.0 * REACH  # increase that resets it as well, as of a new plan; at least twice the way backed out
AHEAD = 0.9  # distance along the path to the point that it turns to
FAR = 4.5  # distance checked along the arc, beyond its end as well, for obstacles to brake for
TURN_WORTH = 3.0  # cost of each radian that is missing of the turn to the path's direction at an arc's end
CURVATURES = np.array([0.0, 0.35, -0.35, 0.7, -0.7, 1.15, -1.15])  # of the arcs tried, in 1 / width


def direction_of(path: LocalPath, pose: Pose2D, width: float) -> Tuple[np.ndarray, float]:
    """Return the point (2,) AHEAD widths (m) along the path, and its bearing from the robot's heading (rad)."""
    ahead = path.point_at(path.robot_arc + AHEAD * width)
    return ahead, angle_between(pose.theta, math.atan2(ahead[1] - pose.y, ahead[0] - pose.x))


class BackOut:
    """Decides when to back out, along which arc or how far back along the trail, and when to stop.

    It begins when driving has failed for PATIENCE, and takes the cheapest way by length, distance of its end from the
    path, and how much of the turn to the path's direction is blocked there. After an attempt without progress, ways
    are twice as long. A car, which cannot turn on the spot, makes a `multi_point_turn` instead.

    Attributes:
        end: End (costmap's frame) of the present or last way; None before.
        trail: Poses of the robot, noted in each cycle.
    """

    def __init__(self) -> None:
        self.trail = Trail()
        self.reset()

    def reset(self) -> None:
        """Forget everything but the trail, for a new goal."""
        self._failing_since: Optional[float] = None
        self.end: Optional[Pose2D] = None
        self._from: Optional[Pose2D] = None
        self._way: Optional[Way] = None
        self._sign, self._curvature, self._length = -1.0, 0.0, 0.0
        self._tries = 0
        self._best_left = math.inf

    @property
    def is_active(self) -> bool:
        """Return whether the robot is backing out."""
        return self._from is not None

    def drove(self, path: LocalPath, width: float) -> None:
        """Note a cycle in which driving succeeded; `width` (m) is the robot's."""
        self._failing_since = None
        self._look_for_progress(path, width)

    def _look_for_progress(self, path: LocalPath, width: float) -> None:
        """Reset the number of tries where the path left is much shorter than the least so far, or much longer."""
        nearer = self._best_left - path.remaining
        if nearer > PROGRESS * width or nearer < -max(ANOTHER_WAY * width, 2.0 * self._length):
            self._best_left, self._tries = path.remaining, 0

    def failed(
        self, now: float, pose: Pose2D, path: LocalPath, checker: FootprintChecker, parameters: FollowerParameters,
        radius: float = 0.0,
    ) -> None:
        """Note a cycle in which driving failed; begin to back out after PATIENCE if a way is free.

        Args:
            now: Time (s).
            pose, path, checker, parameters: The robot's pose, its path, the obstacles, and its limits.
            radius: Minimum turning radius (m); 0 for a robot that turns on the spot.
        """
        if self._failing_since is None or now < self._failing_since:
            self._failing_since = now
        width = checker.costmap.width
        self._look_for_progress(path, width)
        if self._tries >= TRIES or now - self._failing_since < PATIENCE:
            return
        if radius > 0.0:
            self._failing_since = now  # the search is expensive: repeat it only after PATIENCE
            turn = multi_point_turn(pose, path, checker, radius, parameters.min_vel_x < 0.0)
            if turn is not None:
                self._best_left = min(self._best_left, path.remaining)
                self._set_out(pose, turn.poses[-1], turn.arcs[-1], turn)
            return
        ahead, error = direction_of(path, pose, width)
        if abs(error) < ASKEW:
            return
        self._best_left = min(self._best_left, path.remaining)
        arcs = _arc_ends(pose, path, ahead, checker, parameters)
        lengths, costs = arcs.lengths, arcs.costs
        way = self.trail.way_back(pose, checker) if parameters.min_vel_x < 0.0 else None
        if way is not None:
            steps_back, costs_back = _turning_places(way, path, checker)
            lengths, costs = np.append(lengths, way.arcs[steps_back]), np.append(costs, costs_back)
        if self._tries:  # the last attempt was too short
            costs[lengths < min(2.0 * self._length, float(lengths.max(initial=0.0)))] = math.inf
        if not np.isfinite(costs).any():
            return
        best = int(np.argmin(costs))
        if best < len(arcs.costs):
            self._sign, self._curvature = float(arcs.signs[best]), float(arcs.curvatures[best])
            self._set_out(pose, arcs.poses[best], lengths[best], None)
        elif way is not None:
            way.cut(int(steps_back[best - len(arcs.costs)]))
            self._set_out(pose, way.poses[-1], lengths[best], way)

    def _set_out(self, pose: Pose2D, end: np.ndarray, length: float, way: Optional[Way]) -> None:
        """Begin a way of `length` (m) from `pose` to `end`, (3,); where `way` is None, along the arc chosen."""
        self._from, self.end, self._way = pose, Pose2D(*map(float, end)), way
        self._length, self._tries = float(length), self._tries + 1

    def command(
        self, pose: Pose2D, velocity: Twist2D, checker: FootprintChecker, parameters: FollowerParameters, period: float,
        limit: SpeedLimit,
    ) -> Optional[Twist2D]:
        """Return the next velocity along the way; None, which ends it, at its end or where it is blocked."""
        if self._from is None or self.end is None:
            return None
        width = checker.costmap.width
        slowest = SLOWEST * parameters.max_vel_trans
        fastest, top_turn = limit.of(parameters.max_vel_trans, parameters.max_vel_theta)
        fastest = min(SPEED * parameters.max_vel_trans, fastest)
        if self._way is not None:
            top = min(fastest, -parameters.min_vel_x if self._way.goes_back else parameters.max_vel_x)
            command = self._way.command(pose, velocity, checker, parameters, period, (slowest, top), top_turn)
            if command is None:
                self._from, self._failing_since = None, None
            return command
        left = self.end.distance_to(self._from) - pose.distance_to(self._from)  # straight-line distances
        free = 0.0
        if left > 0.0:
            way = np.array([self._sign]), np.array([self._curvature])
            arcs = _arcs(pose, checker, max(left, FAR * width), *way)
            free = float(arcs.step * arcs.free[0])
        if left <= 0.0 or free < 2.0 * checker.step:
            self._from, self._failing_since = None, None
            return None
        highest = parameters.max_vel_x if self._sign > 0.0 else -parameters.min_vel_x
        on_arc = top_turn / abs(self._curvature) if self._curvature else math.inf  # faster, its curve would be wider
        top = min(fastest, highest, on_arc)
        delay = period + parameters.stop_time_buffer
        to_stop = speed_to_stop_within(free, parameters.acc_lim_x, delay)
        wanted = self._sign * min(top, max(slowest, to_stop))
        change = parameters.acc_lim_x * period
        speed = min(velocity.x + change, max(velocity.x - change, wanted))
        most = parameters.acc_lim_theta * period
        # rolling the other way still, it would turn to the wrong side
        wanted_turn = max(0.0, self._sign * speed) * self._curvature
        turn = min(velocity.theta + most, max(velocity.theta - most, wanted_turn))
        return Twist2D(speed, 0.0, min(top_turn, max(-top_turn, turn)))


class _ArcEnds(NamedTuple):
    """Ends of arcs that begin at the robot and are free; an arc has several.

    Attributes:
        signs, curvatures: Shape (K,): of the arc; see `_arcs`.
        poses: Shape (K, 3).
        lengths: Shape (K,): distance (m) along the arc.
        costs: Shape (K,): what it costs to turn there (m).
    """

    signs: np.ndarray
    curvatures: np.ndarray
    poses: np.ndarray
    lengths: np.ndarray
    costs: np.ndarray


def _arc_ends(
    pose: Pose2D, path: LocalPath, ahead: np.ndarray, checker: FootprintChecker, parameters: FollowerParameters
) -> _ArcEnds:
    """Return where the robot might back out to, in steps of LEAST widths along each arc.

    Args:
        pose, path, checker, parameters: The robot's pose, its path, the obstacles, and its limits.
        ahead: The point (2,) that the robot is to turn to.
    """
    width = checker.costmap.width
    bends = CURVATURES if parameters.max_vel_theta > 0.0 else CURVATURES[:1]
    signs = np.repeat([-1.0, 1.0] if parameters.min_vel_x < 0.0 else [1.0], len(bends))
    curvatures = np.resize(bends, len(signs)) / width
    arcs = _arcs(pose, checker, REACH * width, signs, curvatures)
    stride = max(1, round(LEAST * width / arcs.step))
    which, steps = np.nonzero(np.arange(1, arcs.poses.shape[1] + 1) <= arcs.free[:, None])
    kept = (steps + 1) % stride == 0
    which, steps = which[kept], steps[kept]
    ends, lengths = arcs.poses[which, steps], arcs.step * (steps + 1)
    lateral = path.project(ends, -math.inf, math.inf)[:, 0]
    turns = normalize_angles(np.arctan2(ahead[1] - ends[:, 1], ahead[0] - ends[:, 0]) - ends[:, 2])
    costs = lengths + lateral + TURN_WORTH * width * _turns_not_free(ends, turns, checker)
    return _ArcEnds(signs[which], curvatures[which], ends, lengths, costs)


class _Arcs(NamedTuple):
    """Arcs that begin at the robot.

    Attributes:
        poses: Shape (N, S, 3).
        free: Shape (N,): poses before the first contact.
        step: Distance (m) between poses.
    """

    poses: np.ndarray
    free: np.ndarray
    step: float


def _arcs(
    pose: Pose2D, checker: FootprintChecker, length: float, signs: np.ndarray, curvatures: np.ndarray
) -> _Arcs:
    """Return arcs and how far they are free.

    Args:
        pose: Start.
        checker: The obstacles.
        length: Length (m) of each arc.
        signs: Shape (N,): 1 forwards, -1 backwards.
        curvatures: Shape (N,): turn to the left per metre driven, backwards too (rad/m).
    """
    count = math.ceil(length / checker.step)
    targets = np.column_stack((signs, np.zeros(len(signs)), curvatures))
    poses, counts = np.empty((len(signs), count + 1, 3)), np.empty(len(signs), np.int64)
    trajectory_kernels.simulate(
        np.array(pose, dtype=float),
        np.full(3, np.nan),
        np.ones(3),
        targets,
        np.full(len(signs), length),
        checker.step,
        math.inf,
        poses,
        counts,
        np.empty(len(signs)),
    )
    way = checker.first_contacts(poses, counts, np.ones(len(signs)), pose)
    return _Arcs(poses[:, :counts[0]], way.steps, length / int(counts[0]))


def _turning_places(way: Way, path: LocalPath, checker: FootprintChecker) -> Tuple[np.ndarray, np.ndarray]:
    """Return indices (K,) of poses of a way back where the turn to the path is free, and their costs (m), (K,)."""
    width = checker.costmap.width
    arcs = way.arcs[:way.free_poses(checker)]
    marks = np.arange(LEAST * width, arcs[-1], LEAST * width) if len(arcs) else np.zeros(0)
    steps = np.searchsorted(arcs, marks)
    ends = way.poses[steps]
    places = path.project(ends, -math.inf, math.inf)
    ahead = np.array([path.point_at(arc + AHEAD * width) for arc in places[:, 1]]).reshape(-1, 2)
    turns = normalize_angles(np.arctan2(ahead[:, 1] - ends[:, 1], ahead[:, 0] - ends[:, 0]) - ends[:, 2])
    free = _turns_not_free(ends, turns, checker) <= 0.0
    return steps[free], (arcs[steps] + places[:, 0])[free]


def _turns_not_free(poses: np.ndarray, turns: np.ndarray, checker: FootprintChecker) -> np.ndarray:
    """Return the part (rad) of each turn on the spot that is blocked, shape (N,).

    Args:
        poses: Shape (N, 3).
        turns: Shape (N,): turns (rad), positive to the left.
        checker: The obstacles.
    """
    if not len(poses):
        return np.zeros(0)
    counts = np.maximum(1, np.ceil(np.abs(turns) / (2.0 * checker.turn_step))).astype(np.int64)
    turned = np.repeat(poses[:, None], counts.max(), axis=1)
    shares = np.arange(1, counts.max() + 1) / counts[:, None]
    turned[:, :, 2] += turns[:, None] * np.minimum(shares, 1.0)
    way = checker.first_contacts(np.ascontiguousarray(turned), counts, np.ones(len(poses)))
    missing: np.ndarray = np.abs(turns) * (1.0 - way.steps / counts)
    return missing
