"""The tracker: associates the clusters of each scan with known objects, and decides which of them move."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Deque, Iterator, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.tracking import tracker_kernels
from mbf_relay.tracking.clusters import Clusters, Rays, find_clusters, part_clusters, rays_of
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.registration import Walls, odometry_correction, walls_of
from mbf_relay.tracking.track import Track
from mbf_relay.tracking.tracker_kernels import (
    BELIEF,
    COLUMNS,
    CONVINCED,
    NUMBER,
    POSITION,
    RADIUS,
    SEEN,
    VELOCITY,
    VX,
    VY,
    X,
    Y,
)

FIRST_SPEED = 0.5  # m/s, standard deviation of a new object's velocity
LONGER = 2.5  # factor on track_memory for a second, older scan: a slow object covers its own place in the first one
HIDDEN_PATIENCE = 3.0  # factor on track_patience for a moving object that is occluded
HIDDEN_NOISE = 4.0  # factor on track_noise where an object is partly occluded


class _Depths(NamedTuple):
    """The free space of an earlier scan: the sensor's position (m), and depths by direction.

    See `tracker_kernels.arrange`.
    """

    x: float
    y: float
    directions: np.ndarray
    depths: np.ndarray


_NOTHING = _Depths(0.0, 0.0, np.zeros(0), np.zeros(0))


class Tracker:
    """Tracks objects in scans by constant-velocity Kalman filters, and decides which of them move.

    The filters of both coordinates are the same, as a disc is symmetric. An object moves if its velocity differs
    significantly from zero *and* it was once at a place that an earlier scan had seen as free. Objects that come into
    view, or that seem to move as more of them becomes visible, pass the first test but not the second. A place counts
    as free only if its surroundings were free, too: along a wall, beams pass by points that they nearly hit. An object
    that moves straight away from the lidar passes neither test, since it occludes the place where it goes.

    People move at constant velocity until they turn or stop. Where a moving object is far off its prediction, its
    velocity is made uncertain, so that the new position determines it; the gate includes the places to which it may
    have turned back.

    Source: Arras, Grzonka, Luber, Burgard, "Efficient people tracking in laser range data" (2008), for segments and
    filters; Wang, Thorpe, Thrun, "Online simultaneous localization and mapping with detection and tracking of moving
    objects" (2003), for what was seen to be free; Bar-Shalom, Li, Kirubarajan, "Estimation with applications to
    tracking and navigation" (2001), for noise that is raised where a manoeuvre shows.

    Attributes:
        parameters: The values in force.
        moving: Which rays of the last scan hit a moving object, shape (N,), bool.
    """

    def __init__(self, parameters: TrackerParameters, numbers: Optional[Iterator[int]] = None) -> None:
        """Begin without objects; `numbers` can be shared by trackers, so that their tracks' numbers differ."""
        self.parameters = parameters
        self._numbers = itertools.count(1) if numbers is None else numbers
        self.reset()

    def reset(self) -> None:
        """Forget all scans and objects; track numbers are not used again."""
        self._stamp: Optional[float] = None
        self._history: Deque[Tuple[float, _Depths]] = deque()
        self._things = np.zeros((0, COLUMNS))  # the objects, a row each; see tracker_kernels
        self._frame = IDENTITY  # pose of the caller's frame in that of matched scans, in which all is kept
        self._walls: Optional[Walls] = None
        self._tracks: Optional[Tuple[Track, ...]] = None  # cache of `tracks`
        self.moving = np.zeros(0, dtype=bool)

    @property
    def tracks(self) -> Tuple[Track, ...]:
        """The moving objects at the last scan, in the caller's frame."""
        if self._tracks is None:
            self._tracks = self._find_tracks()
        return self._tracks

    def _find_tracks(self) -> Tuple[Track, ...]:
        sure = self._things[self._things[:, BELIEF] >= CONVINCED]
        if not len(sure):
            return ()
        stamp, back = float(self._stamp or 0.0), self._frame.inverse()
        sure[:, [X, Y]] = back.transform_points(sure[:, [X, Y]])
        sure[:, [VX, VY]] = Pose2D(0.0, 0.0, back.theta).transform_points(sure[:, [VX, VY]])
        return tuple(
            Track(int(number), stamp, x, y, vx, vy, radius, *variances)
            for x, y, vx, vy, *variances, radius, _seen, _belief, number in sure.tolist())

    @property
    def stamp(self) -> Optional[float]:
        """Time (s) of the last scan, None before the first."""
        return self._stamp

    def update(
        self, x: float, y: float, ends: np.ndarray, hits: np.ndarray, stamp: float, heading: Optional[float] = None
    ) -> None:
        """Process a scan.

        The tracker is reset where the scan is older than the last one, or later by more than track_patience.

        Args:
            x, y: Position of the sensor (m), in a fixed frame.
            ends: End points of its rays (m), in the order of the beams, finite, shape (N, 2).
            hits: Whether each ray hit something, shape (N,), bool.
            stamp: Time (s).
            heading: Heading of the sensor (rad) in that frame; where None, the direction of the first ray, which must
                then always be the same beam's.
        """
        elapsed = None if self._stamp is None else stamp - self._stamp
        if elapsed is not None and elapsed == 0.0:
            if len(hits) != len(self.moving):  # another scan with the same stamp: nothing is known of its rays
                self.moving = np.zeros(len(hits), dtype=bool)
            return
        if elapsed is not None and not 0.0 < elapsed <= self.parameters.track_patience:
            self.reset()
            elapsed = None
        self._stamp, self._tracks = stamp, None
        if heading is None:
            heading = float(np.arctan2(ends[0, 1] - y, ends[0, 0] - x)) if len(ends) else 0.0
        rays = self._matched(x, y, heading, np.ascontiguousarray(ends[:, :2]), hits)
        self._predict(elapsed or 0.0)
        clusters = self._clusters(rays)
        self._drop_old_scans(stamp)
        noises = self._noises(clusters)
        taken = np.empty(len(noises), np.int64)
        tracker_kernels.associate(self._things, clusters.discs, noises, elapsed or 0.0, taken)
        tracker_kernels.correct(self._things, clusters.discs, noises, taken, stamp, elapsed or 0.0)
        self._update_beliefs(clusters, taken, rays)
        self._begin(clusters.discs, noises, taken, stamp)
        self._forget(rays, stamp)
        order = np.argsort(rays.bearings, kind="stable")
        self._history.append((stamp, _depths_of(rays, order)))
        self._walls = None
        if self.parameters.track_odometry_error > 0.0:
            self._walls = walls_of(rays, heading + self._frame.theta, order, self.moving)

    def _matched(self, x: float, y: float, heading: float, ends: np.ndarray, hits: np.ndarray) -> Rays:
        """Return a scan in the frame of matched scans, after matching it with the one before."""
        x, y, ends = _taken_to(self._frame, x, y, ends)
        if self._walls is not None:
            correction = odometry_correction(
                self._walls, x, y, heading + self._frame.theta, ends, hits, self.parameters.track_odometry_error)
            if correction is not None:
                self._frame = correction.compose(self._frame)
                x, y, ends = _taken_to(correction, x, y, ends)
        return rays_of(x, y, ends, hits)

    def _predict(self, elapsed: float) -> None:
        q = self.parameters.track_acceleration ** 2
        tracker_kernels.predict(
            self._things, elapsed, elapsed ** 2, 0.25 * q * elapsed ** 4, 0.5 * q * elapsed ** 3, q * elapsed ** 2)

    def _clusters(self, rays: Rays) -> Clusters:
        """Return the clusters of a scan, split where moving objects have merged with others."""
        gap = self.parameters.track_gap
        found = find_clusters(rays, gap, self.parameters.track_largest)
        sure = self._things[:, BELIEF] >= CONVINCED
        if not sure.any():
            return found
        return part_clusters(found, rays, self._things[:, [X, Y, RADIUS]], sure, gap)

    def _noises(self, clusters: Clusters) -> np.ndarray:
        """Return the variances (m^2) of the centres of clusters, shape (K,)."""
        whole, hidden = self.parameters.track_noise, self.parameters.track_noise * HIDDEN_NOISE
        return np.where(clusters.discs[:, 3] > 0.0, whole * whole, hidden * hidden)

    def _update_beliefs(self, clusters: Clusters, taken: np.ndarray, rays: Rays) -> None:
        """Update the belief that each object moves, and `moving`.

        Args:
            clusters: The clusters of the scan.
            taken: The object of each cluster, -1 for none, shape (K,).
            rays: The scan.
        """
        self.moving = np.zeros(len(rays.hits), dtype=bool)
        was_free = np.zeros(len(rays.hits), dtype=bool)
        for factor in (1.0, LONGER):
            depths = self._seen_before(factor * self.parameters.track_memory)
            tracker_kernels.mark_free(*depths, rays.ends, was_free)
        tracker_kernels.update_beliefs(
            self._things, clusters.discs, taken, clusters.runs, clusters.order, was_free, self.parameters.track_slowest,
            self.moving)

    def _drop_old_scans(self, stamp: float) -> None:
        """Drop scans that are older than needed for free space."""
        while len(self._history) > 1 and stamp - self._history[1][0] >= LONGER * self.parameters.track_memory - 1e-6:
            self._history.popleft()

    def _seen_before(self, age: float) -> _Depths:
        """Return the newest scan of at least an age (s), an empty one where there is none."""
        assert self._stamp is not None
        for seen, depths in reversed(self._history):
            if self._stamp - seen >= age - 1e-6:
                return depths
        return _NOTHING

    def _begin(self, discs: np.ndarray, noises: np.ndarray, taken: np.ndarray, stamp: float) -> None:
        """Add an object for each cluster without one.

        Args:
            discs, noises: The clusters; see tracker_kernels.
            taken: The object of each cluster, -1 for none, shape (K,).
            stamp: Time (s).
        """
        new = (taken < 0).nonzero()[0]
        if not len(new):
            return
        rows = np.zeros((len(new), COLUMNS))
        rows[:, :2], rows[:, RADIUS] = discs[new, :2], discs[new, 2]
        rows[:, POSITION], rows[:, VELOCITY] = noises[new], FIRST_SPEED ** 2
        rows[:, SEEN] = stamp
        rows[:, NUMBER] = list(itertools.islice(self._numbers, len(new)))
        self._things = np.concatenate((self._things, rows))

    def _forget(self, rays: Rays, stamp: float) -> None:
        away, patience = stamp - self._things[:, SEEN], self.parameters.track_patience
        kept = away < patience
        if kept.all():
            return
        is_sure = self._things[:, BELIEF] >= CONVINCED
        for thing in np.flatnonzero(~kept & is_sure & (away < HIDDEN_PATIENCE * patience)):
            kept[thing] = self._is_hidden(thing, rays)
        self._things = self._things[kept]

    def _is_hidden(self, thing: int, rays: Rays) -> bool:
        """Return whether an object is occluded at its predicted position."""
        across, up = self._things[thing, X] - rays.x, self._things[thing, Y] - rays.y
        turns = np.abs(rays.bearings - np.arctan2(up, across))
        if not len(turns):
            return False
        ray = int(np.argmin(np.minimum(turns, 2.0 * np.pi - turns)))
        return bool(rays.hits[ray] and rays.ranges[ray] < np.hypot(across, up) - self._things[thing, RADIUS])


def _taken_to(frame: Pose2D, x: float, y: float, ends: np.ndarray) -> Tuple[float, float, np.ndarray]:
    """Return a scan's position and end points in another frame, in which `frame` is the pose of the present one."""
    if frame == IDENTITY:
        return x, y, ends
    (x, y), ends = frame.transform_points(np.array([[x, y]]))[0].tolist(), frame.transform_points(ends)
    return x, y, ends


def _depths_of(rays: Rays, order: np.ndarray) -> _Depths:
    directions, depths = np.empty(len(rays.hits)), np.empty(len(rays.hits))
    tracker_kernels.arrange(rays.bearings, rays.ranges, order, directions, depths)
    return _Depths(rays.x, rays.y, directions, depths)
