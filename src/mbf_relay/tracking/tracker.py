"""The tracker: which clusters of each scan are the things of the last one, and which of them move."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Deque, Iterator, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.tracking import tracker_kernels
from mbf_relay.tracking.clusters import Clusters, Rays, find_clusters, part_clusters, rays_of
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.registration import Walls, misplaced, walls_of
from mbf_relay.tracking.track import Track
from mbf_relay.tracking.tracker_kernels import (
    BELIEF,
    COLUMNS,
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

GATE = 9.0  # squared deviations within which a cluster may be a thing seen before
SURPRISE = 3.0  # squared deviations from its place, as foreseen, from which on what moves has stopped or turned
FIRST_SPEED = 0.5  # m/s: deviation of the velocity of a thing seen for the first time
DEPTH = 0.08  # m behind a place that must have been seen for it to have been empty
ASIDE = 0.05  # m to both sides of it that must have been seen past as well, for no scan lies where it was on the last
LONGER = 2.5  # factor on the memory: who is slow has not left his place after the first time, and has after the second
CONVINCED, MOST_CONVINCED = 2, 5  # scans in favour, less those against: when a thing moves, and the most that counts
HIDDEN_PATIENCE = 3.0  # factor on how long a thing that moves is remembered while something stands before it
HIDDEN_NOISE = 4.0  # factor on the deviation where only a part is seen


class _Depths(NamedTuple):
    """How far a scan saw: where it was taken (m), and its rays by their directions; see tracker_kernels.arrange."""

    x: float
    y: float
    directions: np.ndarray
    depths: np.ndarray


_NOTHING = _Depths(0.0, 0.0, np.zeros(0), np.zeros(0))


class Tracker:
    """Follows what is seen in scans by constant-velocity Kalman filters, and tells what moves.

    Each coordinate has the same filter, as a disc has no sides. A thing moves if its velocity differs from zero for
    sure *and* it stood once where a while before the lidar had seen through: what merely comes into view, or seems to
    move because more of it does, passes the first test and not the second. A place was seen through where what is
    beside it was, too: along a wall beams pass that by a hair would have met it. What moves straight away from the
    lidar passes neither: it hid where it goes to.

    Constant velocity is what people have till they turn. Who moves and is off the place foreseen has turned or stopped:
    his velocity is then what his new place says, and he is looked for as far back as he can have come.

    Source: Arras, Grzonka, Luber, Burgard, "Efficient people tracking in laser range data" (2008), for segments and
    filters; Wang, Thorpe, Thrun, "Online simultaneous localization and mapping with detection and tracking of moving
    objects" (2003), for what was seen to be free; Bar-Shalom, Li, Kirubarajan, "Estimation with applications to
    tracking and navigation" (2001), for noise that is raised where a manoeuvre shows.

    Attributes:
        parameters: The values in force.
        moving: Shape (N,), bool: which rays of the last scan end on what moves.
    """

    def __init__(self, parameters: TrackerParameters, numbers: Optional[Iterator[int]] = None) -> None:
        """Follow nothing yet; `numbers` of tracks are shared by trackers whose tracks must not be confused."""
        self.parameters = parameters
        self._numbers = itertools.count(1) if numbers is None else numbers
        self.reset()

    def reset(self) -> None:
        """Forget everything; numbers are not used again."""
        self._stamp: Optional[float] = None
        self._history: Deque[Tuple[float, _Depths]] = deque()
        self._things = np.zeros((0, COLUMNS))  # a row each; see tracker_kernels
        self._frame = IDENTITY  # in which all this is: that of scans laid on each other, for odometry's goes astray
        self._walls: Optional[Walls] = None
        self._tracks: Optional[Tuple[Track, ...]] = None  # once asked for
        self.moving = np.zeros(0, dtype=bool)

    @property
    def tracks(self) -> Tuple[Track, ...]:
        """What moves, as of the last scan."""
        if self._tracks is None:  # asked for several times a scan
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
        """Take a scan.

        A scan that is older than the last one, or much younger, begins anew: a clock was set.

        Args:
            x, y: Where the sensor was (m), in a frame that stands still.
            ends: Shape (N, 2), where its rays end (m), in the order of the beams; finite.
            hits: Shape (N,), bool: whether anything was there.
            stamp: Time (s).
            heading: Which way the sensor faced (rad), in that frame; None for that of the first ray, which must be the
                same beam's every time then.
        """
        elapsed = None if self._stamp is None else stamp - self._stamp
        if elapsed is not None and elapsed == 0.0:
            if len(hits) != len(self.moving):  # another scan of that moment, in whose rays nothing is known to move
                self.moving = np.zeros(len(hits), dtype=bool)
            return
        if elapsed is not None and not 0.0 < elapsed <= self.parameters.track_patience:
            self.reset()
            elapsed = None
        self._stamp, self._tracks = stamp, None
        if heading is None:
            heading = float(np.arctan2(ends[0, 1] - y, ends[0, 0] - x)) if len(ends) else 0.0
        rays = self._laid(x, y, heading, np.ascontiguousarray(ends[:, :2]), hits)
        self._predict(elapsed or 0.0)
        clusters = self._clusters(rays)
        self._drop_old_scans(stamp)
        noises = self._noises(clusters)
        taken = np.empty(len(noises), np.int64)
        tracker_kernels.associate(
            self._things, clusters.discs, noises, GATE, elapsed or 0.0, CONVINCED, taken)
        tracker_kernels.correct(
            self._things, clusters.discs, noises, taken, stamp, elapsed or 0.0, SURPRISE, CONVINCED)
        self._judge(clusters, taken, rays)
        self._begin(clusters.discs, noises, taken, stamp)
        self._forget(rays, stamp)
        order = np.argsort(rays.bearings, kind="stable")
        self._history.append((stamp, _depths_of(rays, order)))
        self._walls = None
        if self.parameters.track_odometry_error > 0.0:
            self._walls = walls_of(rays, heading + self._frame.theta, order, self.moving)

    def _laid(self, x: float, y: float, heading: float, ends: np.ndarray, hits: np.ndarray) -> Rays:
        """Return a scan as it lies on the one before it, in the frame of the first."""
        x, y, ends = _taken_to(self._frame, x, y, ends)
        if self._walls is not None:
            wrong = misplaced(
                self._walls, x, y, heading + self._frame.theta, ends, hits, self.parameters.track_odometry_error)
            if wrong is not None:
                self._frame = wrong.compose(self._frame)
                x, y, ends = _taken_to(wrong, x, y, ends)
        return rays_of(x, y, ends, hits)

    def _predict(self, elapsed: float) -> None:
        q = self.parameters.track_acceleration ** 2
        tracker_kernels.predict(
            self._things, elapsed, elapsed ** 2, 0.25 * q * elapsed ** 4, 0.5 * q * elapsed ** 3, q * elapsed ** 2)

    def _clusters(self, rays: Rays) -> Clusters:
        """Return the things in a scan, those parted that run into one where something moves."""
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

    def _judge(self, clusters: Clusters, taken: np.ndarray, rays: Rays) -> None:
        """Take what speaks for and against the moving of what was seen.

        Args:
            clusters: Of the scan.
            taken: Shape (K,): which thing each is, -1 for none.
            rays: The scan.
        """
        self.moving = np.zeros(len(rays.hits), dtype=bool)
        memory = self.parameters.track_memory
        tracker_kernels.judge(
            self._things, clusters.discs, taken, rays.ends, clusters.runs, clusters.order, *self._seen_before(memory),
            *self._seen_before(LONGER * memory), self.parameters.track_slowest, DEPTH, ASIDE, CONVINCED, MOST_CONVINCED,
            self.moving)

    def _drop_old_scans(self, stamp: float) -> None:
        """Keep of the scans those that tell what was empty."""
        while len(self._history) > 1 and stamp - self._history[1][0] >= LONGER * self.parameters.track_memory - 1e-6:
            self._history.popleft()

    def _seen_before(self, age: float) -> _Depths:
        """Return how far the youngest scan saw that is so old (s), nothing where none is."""
        assert self._stamp is not None
        for seen, depths in reversed(self._history):
            if self._stamp - seen >= age - 1e-6:
                return depths
        return _NOTHING

    def _begin(self, discs: np.ndarray, noises: np.ndarray, taken: np.ndarray, stamp: float) -> None:
        """Follow things seen for the first time.

        Args:
            discs, noises: The clusters; see tracker_kernels.
            taken: Shape (K,): below 0 for those.
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
        """Return whether something stands before the place where a thing should be by now."""
        across, up = self._things[thing, X] - rays.x, self._things[thing, Y] - rays.y
        turns = np.abs(rays.bearings - np.arctan2(up, across))
        if not len(turns):
            return False
        ray = int(np.argmin(np.minimum(turns, 2.0 * np.pi - turns)))
        return bool(rays.hits[ray] and rays.ranges[ray] < np.hypot(across, up) - self._things[thing, RADIUS])


def _taken_to(frame: Pose2D, x: float, y: float, ends: np.ndarray) -> Tuple[float, float, np.ndarray]:
    """Return where a scan was taken, and where its rays end, in another frame; as for `Tracker.update`."""
    if frame == IDENTITY:
        return x, y, ends
    (x, y), ends = frame.transform_points(np.array([[x, y]]))[0].tolist(), frame.transform_points(ends)
    return x, y, ends


def _depths_of(rays: Rays, order: np.ndarray) -> _Depths:
    directions, depths = np.empty(len(rays.hits)), np.empty(len(rays.hits))
    tracker_kernels.arrange(rays.bearings, rays.ranges, order, directions, depths)
    return _Depths(rays.x, rays.y, directions, depths)
