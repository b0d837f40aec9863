"""The tracker: which clusters of each scan are the things of the last one, and which of them move."""

from __future__ import annotations

from collections import deque
from typing import Deque, List, Optional, Tuple

import numpy as np

from mbf_relay.tracking.clusters import Cluster, Rays, find_clusters, part, rays_of
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.track import Track

GATE = 9.0  # squared deviations within which a cluster may be a thing seen before
FIRST_SPEED = 0.5  # m/s: deviation of the velocity of a thing seen for the first time
SEEN_EMPTY = 0.25  # share of its readings where there was nothing before, from which on a thing may have come there
DEPTH = 0.08  # m behind a place that must have been seen for it to have been empty
SURE = 1.0  # deviations of the velocity by which it must differ from zero: its place is the test that standing fails
LONGER = 2.5  # factor on the memory: who is slow has not left his place after the first time, and has after the second
CONVINCED, MOST_CONVINCED = 2, 5  # scans in favour, less those against: when a thing moves, and the most that counts
HIDDEN_PATIENCE = 3.0  # factor on how long a thing that moves is remembered while something stands before it
HIDDEN_NOISE = 4.0  # factor on the deviation where only a part is seen


class Tracker:
    """Follows what is seen in scans by constant-velocity Kalman filters, and tells what moves.

    Each coordinate has the same filter, as a disc has no sides. A thing moves if its velocity differs from zero for
    sure *and* it stood once where a while before the lidar had seen through: what merely comes into view, or seems to
    move because more of it does, passes the first test and not the second. What moves straight away from the lidar
    passes neither: it hid where it goes to.

    Source: Arras, Grzonka, Luber, Burgard, "Efficient people tracking in laser range data" (2008), for segments and
    filters; Wang, Thorpe, Thrun, "Online simultaneous localization and mapping with detection and tracking of moving
    objects" (2003), for what was seen to be free.

    Attributes:
        parameters: The values in force.
        moving: Shape (N,), bool: which rays of the last scan end on what moves.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        self._next_number = 1
        self.reset()

    def reset(self) -> None:
        """Forget everything; numbers are not used again."""
        self._stamp: Optional[float] = None
        self._history: Deque[Tuple[float, Rays]] = deque()
        self._numbers = np.zeros(0, np.int64)
        self._states = np.zeros((0, 4))  # x, y, vx, vy
        self._variances = np.zeros((0, 3))  # of position, position with velocity, velocity; alike for x and y
        self._radii = np.zeros(0)
        self._seen = np.zeros(0)
        self._belief = np.zeros(0, np.int64)
        self.moving = np.zeros(0, dtype=bool)

    @property
    def tracks(self) -> Tuple[Track, ...]:
        """What moves, as of the last scan."""
        sure = self._belief >= CONVINCED
        if not sure.any():
            return ()
        return tuple(
            Track(int(number), float(self._stamp or 0.0), x, y, vx, vy, float(radius), *variances)
            for number, (x, y, vx, vy), radius, variances in zip(
                self._numbers[sure], self._states[sure].tolist(), self._radii[sure], self._variances[sure].tolist())
        )

    def update(self, x: float, y: float, ends: np.ndarray, hits: np.ndarray, stamp: float) -> None:
        """Take a scan.

        A scan that is older than the last one, or much younger, begins anew: a clock was set.

        Args:
            x, y: Where the sensor was (m), in a frame that stands still.
            ends: Shape (N, 2), where its rays end (m), in the order of the beams; finite.
            hits: Shape (N,), bool: whether anything was there.
            stamp: Time (s).
        """
        elapsed = None if self._stamp is None else stamp - self._stamp
        if elapsed is not None and elapsed == 0.0:
            return
        if elapsed is not None and not 0.0 < elapsed <= self.parameters.track_patience:
            self.reset()
            elapsed = None
        self._stamp = stamp
        rays = rays_of(x, y, np.ascontiguousarray(ends[:, :2]), hits)
        self._predict(elapsed or 0.0)
        clusters = self._clusters(rays)
        self._drop_old_scans(stamp)
        discs, noises = self._measured(clusters)
        taken = self._associate(discs, noises)
        known, new = (taken >= 0).nonzero()[0], (taken < 0).nonzero()[0]
        things, seen = taken[known], [clusters[index] for index in known]
        if len(things):
            self._correct(things, discs[known], noises[known], stamp)
            self._judge(things, seen, rays, stamp)
        self.moving = np.zeros(len(hits), dtype=bool)
        for index in (self._belief[things] >= CONVINCED).nonzero()[0]:
            self.moving[seen[index].readings] = True
        self._begin(discs[new], noises[new], stamp)
        self._forget(rays, stamp)
        self._history.append((stamp, rays))

    def _predict(self, elapsed: float) -> None:
        q = self.parameters.track_acceleration ** 2
        position, cross, velocity = self._variances.T
        self._states[:, :2] += elapsed * self._states[:, 2:]
        predicted = np.empty_like(self._variances)
        predicted[:, 0] = position + 2.0 * elapsed * cross + elapsed ** 2 * velocity + 0.25 * q * elapsed ** 4
        predicted[:, 1] = cross + elapsed * velocity + 0.5 * q * elapsed ** 3
        predicted[:, 2] = velocity + q * elapsed ** 2
        self._variances = predicted

    def _clusters(self, rays: Rays) -> List[Cluster]:
        """Return the things in a scan, those parted that run into one where something moves."""
        gap = self.parameters.track_gap
        found = find_clusters(rays, gap, self.parameters.track_largest)
        sure = self._belief >= CONVINCED
        if not sure.any():
            return found
        discs, parted = np.column_stack((self._states[:, :2], self._radii)), []
        moving = discs[sure]
        for cluster in found:
            near = np.hypot(moving[:, 0] - cluster.x, moving[:, 1] - cluster.y) < cluster.radius + moving[:, 2] + gap
            parted += part(cluster, rays, discs, gap) if near.any() else [cluster]
        return parted

    def _measured(self, clusters: List[Cluster]) -> Tuple[np.ndarray, np.ndarray]:
        """Return clusters as discs (x, y and radius in m), shape (K, 3), and the variances (m^2) of their centres."""
        discs = np.array([cluster[:3] for cluster in clusters]).reshape(-1, 3)
        whole, hidden = self.parameters.track_noise, self.parameters.track_noise * HIDDEN_NOISE
        deviations = np.array([whole if cluster.is_whole else hidden for cluster in clusters])
        return discs, deviations * deviations

    def _associate(self, discs: np.ndarray, noises: np.ndarray) -> np.ndarray:
        """Return for each cluster the thing it is, -1 for none: the nearest pairs first, by deviations.

        Args:
            discs, noises: The clusters; see _measured.
        """
        taken = np.full(len(discs), -1)
        off = self._states[:, None, :2] - discs[:, :2]
        distances = ((off ** 2).sum(axis=2) / (self._variances[:, 0][:, None] + noises)).ravel()
        pairs = (distances <= GATE).nonzero()[0]
        free = [True] * len(self._numbers)
        for pair in pairs[np.argsort(distances[pairs], kind="stable")].tolist():
            thing, cluster = divmod(pair, len(discs))
            if free[thing] and taken[cluster] < 0:
                taken[cluster], free[thing] = thing, False
        return taken

    def _correct(self, things: np.ndarray, discs: np.ndarray, noises: np.ndarray, stamp: float) -> None:
        """Take where things were seen, each of them once.

        Args:
            things: Shape (K,): which.
            discs, noises: Their clusters; see _measured.
            stamp: Time (s).
        """
        position, cross, velocity = self._variances[things].T
        total = position + noises
        off = discs[:, :2] - self._states[things, :2]
        self._states[things, :2] += (position / total)[:, None] * off
        self._states[things, 2:] += (cross / total)[:, None] * off
        corrected = np.empty((len(things), 3))
        corrected[:, 0] = position - position * position / total
        corrected[:, 1] = cross - position * cross / total
        corrected[:, 2] = velocity - cross * cross / total
        self._variances[things] = corrected
        self._seen[things] = stamp

    def _judge(self, things: np.ndarray, seen: List[Cluster], rays: Rays, stamp: float) -> None:
        """Take how large things were seen, and what speaks for and against their moving.

        Args:
            things: Shape (K,): which.
            seen: Their clusters.
            rays: The scan.
            stamp: Time (s).
        """
        radii, seen_radii = self._radii[things], np.array([cluster.radius for cluster in seen])
        is_whole = np.array([cluster.is_whole for cluster in seen])
        radii = np.where(is_whole, radii + 0.3 * (seen_radii - radii), radii)
        self._radii[things] = np.maximum(radii, seen_radii)
        speeds = np.hypot(self._states[things, 2], self._states[things, 3])
        sure = SURE * np.sqrt(self._variances[things, 2])
        is_fast = speeds >= np.maximum(self.parameters.track_slowest, sure)
        is_known = self._belief[things] >= CONVINCED  # it came once; one that nears slowly is seen to no more
        came, asked = is_known.copy(), (is_fast & ~is_known).nonzero()[0].tolist()
        if asked:
            was_empty = self._was_empty(rays, stamp)
            for index in asked:
                readings = seen[index].readings
                came[index] = np.count_nonzero(was_empty[readings]) / len(readings) >= SEEN_EMPTY
        against = np.where(is_known & ~is_whole, 0, -1)  # half hidden, it seems to stand or to jump
        change = np.where(is_fast & came, 1, against)
        self._belief[things] = np.minimum(MOST_CONVINCED, np.maximum(0, self._belief[things] + change))

    def _drop_old_scans(self, stamp: float) -> None:
        """Keep of the scans those that tell what was empty."""
        while len(self._history) > 1 and stamp - self._history[1][0] >= LONGER * self.parameters.track_memory - 1e-6:
            self._history.popleft()

    def _was_empty(self, rays: Rays, stamp: float) -> np.ndarray:
        """Return for each ray whether the lidar saw beyond where it ends, a while ago or longer: shape (N,), bool."""
        memory = self.parameters.track_memory
        result = np.zeros(len(rays.hits), dtype=bool)
        for age in (memory, LONGER * memory):
            before = next((each for seen, each in reversed(self._history) if stamp - seen >= age - 1e-6), None)
            if before is not None and len(before.bearings):
                result |= _sees_past(before, rays.ends)
        return result

    def _begin(self, discs: np.ndarray, noises: np.ndarray, stamp: float) -> None:
        """Follow things seen for the first time.

        Args:
            discs, noises: Their clusters; see _measured.
            stamp: Time (s).
        """
        count = len(discs)
        if not count:
            return
        nothing = np.zeros(count)
        rows = np.column_stack((discs[:, :2], nothing, nothing))
        variances = np.column_stack((noises, nothing, np.full(count, FIRST_SPEED ** 2)))
        self._numbers = np.append(self._numbers, np.arange(self._next_number, self._next_number + count))
        self._next_number += count
        self._states = np.vstack((self._states, rows))
        self._variances = np.vstack((self._variances, variances))
        self._radii = np.append(self._radii, discs[:, 2])
        self._seen = np.append(self._seen, np.full(count, stamp))
        self._belief = np.append(self._belief, np.zeros(count, np.int64))

    def _forget(self, rays: Rays, stamp: float) -> None:
        away, patience = stamp - self._seen, self.parameters.track_patience
        kept = away < patience
        if kept.all():
            return
        for thing in np.flatnonzero(~kept & (self._belief >= CONVINCED) & (away < HIDDEN_PATIENCE * patience)):
            kept[thing] = self._is_hidden(thing, rays)
        if kept.all():
            return
        self._numbers, self._states, self._variances = self._numbers[kept], self._states[kept], self._variances[kept]
        self._radii, self._seen, self._belief = self._radii[kept], self._seen[kept], self._belief[kept]

    def _is_hidden(self, thing: int, rays: Rays) -> bool:
        """Return whether something stands before the place where a thing should be by now."""
        across, up = self._states[thing, 0] - rays.x, self._states[thing, 1] - rays.y
        turns = np.abs(rays.bearings - np.arctan2(up, across))
        ray = int(np.argmin(np.minimum(turns, 2.0 * np.pi - turns)))
        return bool(rays.hits[ray] and rays.ranges[ray] < np.hypot(across, up) - self._radii[thing])


def _sees_past(before: Rays, ends: np.ndarray) -> np.ndarray:
    """Return for each point, shape (N, 2), whether a scan saw beyond it, shape (N,), bool."""
    order = np.argsort(before.bearings, kind="stable")
    sorted_bearings, depths = before.bearings[order], before.ranges[order]
    least = np.minimum(depths, np.minimum(np.roll(depths, 1), np.roll(depths, -1)))  # an edge sees past itself
    across, up = ends[:, 0] - before.x, ends[:, 1] - before.y
    bearings, distances = np.arctan2(up, across), np.hypot(across, up)
    index = np.searchsorted(sorted_bearings, bearings) % len(order)
    turn = np.abs(sorted_bearings[index] - bearings)
    in_view = np.minimum(turn, 2.0 * np.pi - turn) < 0.1
    passed: np.ndarray = in_view & (least[index] > distances + DEPTH)
    return passed
