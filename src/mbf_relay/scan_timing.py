"""When a lidar takes its beams, told by how its scans turn and how odometry does; and its scans, set right by that."""

from __future__ import annotations

import collections
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Callable, Deque, NamedTuple, Optional

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D, angle_between, normalize_angles
from mbf_relay.outcomes import TransformError
from mbf_relay.scan import LaserScan
from mbf_relay.scan_sweep import AT_ONCE, ORDERS, REACH, Order, ends, resampled, seen_at_once

STEP = 0.05
"""Seconds from one offset to the next."""
OFFSETS = np.arange(-12, 13) * STEP
"""Seconds by which scans may be dated late, or early where negative, that are told from each other."""
STRIDE = math.radians(1.0)
DIRECTIONS = STRIDE * np.arange(-180.0, 180.0)
"""Directions in which two scans are held against each other, and from one to the next."""
MARGIN, PATIENCE = 0.1, 0.5
"""Seconds by which odometry may come after a scan that is dated alike, and after which it is asked for no more."""
BETWEEN, POSES = 0.1, 50
"""Seconds from one time at which odometry is asked for a pose to the next, and how many of the newest are remembered:
those round two scans a second apart."""
NEARLY = 0.06
"""Seconds by which offsets differ that are all but one."""
SPACING = 0.15
"""Seconds between the scans that are compared: a quick lidar's next one is hardly turned, and would tell nothing."""
MISSING = 1.0
"""Seconds without a scan after which the next one is compared with none before."""
SET_BACK = 3.0
"""Seconds by which a scan must be older than the newest for the clock to have been set; else it is only late."""
FARTHEST_TURN = 52
"""Degrees from one scan to the next, at most: a TurtleBot3 at its top turn rate comes 33 between two scans."""
LEAST_CHANGE = 0.1
"""Radians that odometry must have turned more at one offset than at another for two scans to tell anything."""
TURNS = np.arange(-FARTHEST_TURN, FARTHEST_TURN + 1)
"""Turns between two scans that are tried (degrees)."""
TURNED = (np.arange(len(DIRECTIONS)) + TURNS[:, None]) % len(DIRECTIONS)
"""Of each direction, after each of those turns, the one it was before, shape (T, D)."""
ASIDE = 12
"""Degrees beside the turns that odometry has, at any offset, in which the likeliest turn of two scans is looked for."""
NEARBY = TURNED[np.abs(TURNS) <= 15]
"""Of those, the ones by which two scans may lie aside that are laid on each other by odometry: wheels slip."""
FEWEST_BEAMS = 60
"""Directions in which both scans must read something."""
LARGEST_ERROR = 0.3
"""Radians, and metres of a reading, that count at most: people walk by, and edges hide and show."""
SIMILAR = 0.08
"""Metres by which the readings of two scans may differ, in the mean, once they are turned into each other."""
CLEARER = 0.7
"""Of the next likely turn's difference: so much less the likeliest must have, or the room looks alike all round."""
LIKEWISE = 6
"""Degrees within which two turns are one."""
PAIRS, FEWEST_PAIRS = 200, 20
"""Of scans that tell something: the newest that are remembered, and how many it takes."""
NOISE = 0.02
"""Radians to which the turn between two scans is told at best."""
CERTAIN, MOST_OF_ONE = 15.0, 3.0
"""Logarithms of how much likelier an offset must be than none, and what one pair counts at most."""
FITS = 0.06
"""Radians, root mean square, within which turns must agree at the offset."""
PARTNERS = 4
"""Scans before one, among which it is held against the one that was taken in the most different turn."""
DIFFERENT = 0.06
"""Radians that the robot must turn more while one scan is taken than while the other is."""
LEAD = 4
"""Such pairs by which one order must be ahead of each other one: of some 400 in simulation, 1 spoke for a wrong one."""
ENOUGH = 20
"""Of them, after which no more are looked for: a lidar keeps to its order."""
SPEAKING = 0.25
"""Share of such pairs that must speak for it: where none of the orders is right, one may now and then seem to be."""
SPACINGS = 20
"""Scans of which the middle one of the times from one to the next is the time that a lidar turns in."""
OUT_OF, NEARLY_WHOLE = 10, 0.1
"""Scans of which a throttle passes one, at most; and how far from a whole number the spacing over the driver's own time
for a scan may be, as a share: drivers fill that in carelessly, and what is no throttle's doing is not believed."""
LATELY = 0.1
"""Seconds over which odometry is asked how the robot moves while a scan is taken."""
FARTHEST_MOVED = 0.5
"""Metres, and radians, that a lidar comes in LATELY at most: beyond, odometry was set to another place."""


class _Dated(NamedTuple):
    """A pose by odometry at a time (s), its turns counted; NaN where it is not known."""

    time: float
    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class _Taken:
    """A scan, and of odometry its headings (rad) at each of OFFSETS before the stamp.

    And where the lidar was when the middle beam was taken, how it moves while a turning sensor looks round once, and
    the order in which it takes its beams as far as that is known.
    """

    scan: LaserScan
    headings: np.ndarray
    pose: Pose2D
    moved: Pose2D
    order: Order

    @cached_property
    def readings(self) -> np.ndarray:
        """What it reads in DIRECTIONS (m), as if all at once; of most scans nobody asks for it."""
        return _readings(
            self.scan if self.order == AT_ONCE else seen_at_once(self.scan, self.order, self.moved))


class ScanTiming:
    """Compares one lidar's scans with each other, by how the robot turned between them and in them as odometry has it.

    It needs neither a map nor a pose. Two scans in a row tell by which angle the robot turned between them, odometry
    when: where clocks differ, or a driver dates scans when they are sent, odometry turns before or after what the lidar
    sees does. And most lidars look round once and need a fifth or a tenth of a second for it, in which a robot that
    turns turns on: a scan is stretched or compressed by that, as the sensor turns against the robot or with it. Two
    scans of which one was taken in a turn and the other was not lie on each other only if one knows which beam came
    first, and messages do not tell: the drivers of the LDS-01 and of RPLidars send the last one first.

    Attributes:
        late: Seconds by which scans are dated later than their middle beam is taken, by odometry's time; None where
            nothing tells.
        order: Of the beams; None where nothing tells.
    """

    def __init__(self) -> None:
        self.late: Optional[float] = None
        self.order: Optional[Order] = None
        self._stamps: Deque[float] = collections.deque(maxlen=SPACINGS + 1)
        self._waiting: Deque[LaserScan] = collections.deque()
        self._taken: Deque[_Taken] = collections.deque(maxlen=PARTNERS)
        self._poses: Deque[_Dated] = collections.deque(maxlen=POSES)
        self._heading = 0.0  # the newest known, turns counted
        self._errors: Deque[np.ndarray] = collections.deque(maxlen=PAIRS)  # of turns, at OFFSETS
        self._votes = np.zeros(len(ORDERS), dtype=int)  # of pairs of scans, for each of ORDERS
        self._contrasts = 0

    def corrected(self, scan: LaserScan, pose_at: Callable[[float], Pose2D]) -> LaserScan:
        """Return a scan as if all its beams had been taken at once, dated by odometry's time.

        Args:
            scan: It, seen from above.
            pose_at: As for `take`.
        """
        stamp, order = scan.stamp - (self.late or 0.0), self.order or AT_ONCE
        if order != AT_ONCE:
            try:
                moved = pose_at(stamp).relative_to(pose_at(stamp - LATELY))
            except TransformError:
                moved = IDENTITY  # at a start; whoever uses the scan asks for its time as well
            if 0.0 < max(map(abs, moved)) <= FARTHEST_MOVED:
                part = self._sweep_time(scan) / LATELY
                scan = seen_at_once(scan, order, Pose2D(part * moved.x, part * moved.y, part * moved.theta))
        return scan if stamp == scan.stamp else replace(scan, stamp=stamp)

    def take(self, scan: LaserScan, pose_at: Callable[[float], Pose2D]) -> None:
        """Take the next scan.

        Args:
            scan: It, seen from above, as it came.
            pose_at: Gives the lidar's pose by odometry at a time (s), or raises TransformError; asked for times as long
                before and after a scan as OFFSETS reach, once those have passed.
        """
        since = scan.stamp - self._stamps[-1] if self._stamps else MISSING
        if -SET_BACK < since <= 0.0:
            return
        if since < 0.0:  # the clock was set
            self.late = None
            self._errors.clear()
        if not 0.0 < since < MISSING:  # or scans are lost
            for memory in (self._stamps, self._waiting, self._taken, self._poses):
                memory.clear()
        self._stamps.append(scan.stamp)
        if self._waiting and scan.stamp - self._waiting[-1].stamp < SPACING:
            return
        self._waiting.append(scan)
        self._follow(scan.stamp - MARGIN, pose_at)
        while len(self._waiting) > 1 and self._poses and self._waiting[0].stamp + OFFSETS[-1] <= self._poses[-1].time:
            self._compare(self._waiting.popleft())

    def _follow(self, until: float, pose_at: Callable[[float], Pose2D]) -> None:
        """Ask odometry for its poses up to a time (s), from where the first scan that waits may be dated to."""
        time = self._poses[-1].time + BETWEEN if self._poses else self._waiting[0].stamp - OFFSETS[-1]
        while time <= until:
            try:
                pose = pose_at(time)
                self._heading += angle_between(self._heading, pose.theta)
                self._poses.append(_Dated(time, pose.x, pose.y, self._heading))
            except TransformError:
                if time > until - PATIENCE:
                    return  # it may come yet
                self._poses.append(_Dated(time, math.nan, math.nan, math.nan))
            time += BETWEEN

    def _sweep_time(self, scan: LaserScan) -> float:
        """Return the time (s) from a scan's first beam to its last where a sensor that turns takes them.

        It turns once from scan to scan, or a few times where scans are throttled, which the driver's own time tells.
        """
        if len(self._stamps) < 2:
            return 0.0
        share = len(scan.ranges) * abs(scan.angle_increment) / (2.0 * math.pi)
        stamps = list(self._stamps)
        spacings = sorted(after - before for before, after in zip(stamps, stamps[1:]))
        middle = len(spacings) // 2  # NumPy's median takes longer than all else that most scans need
        whole = min(1.0, share) * 0.5 * (spacings[middle] + spacings[~middle])
        turns = round(min(whole / scan.sweep_time, 2 * OUT_OF)) if scan.sweep_time > 0.0 else 1
        is_throttled = 1 < turns <= OUT_OF and abs(whole / (turns * scan.sweep_time) - 1.0) < NEARLY_WHOLE
        return scan.sweep_time if is_throttled else whole

    def _compare(self, scan: LaserScan) -> None:
        """Hold a scan against those before it."""
        times, x, y, headings = np.array(self._poses).T

        def pose_at(time: float) -> Pose2D:
            return Pose2D(*(float(np.interp(time, times, values)) for values in (x, y, headings)))

        middle, half = scan.stamp - (self.late or 0.0), 0.5 * self._sweep_time(scan)
        turned, pose = np.interp(scan.stamp - OFFSETS, times, headings), pose_at(middle)
        moved = pose_at(middle + half).relative_to(pose_at(middle - half))
        if np.isnan(turned).any() or not (pose.is_finite() and moved.is_finite()):
            return
        taken = _Taken(scan, turned, pose, moved, self.order or AT_ONCE)
        if self._taken:
            self._compare_turns(self._taken[-1], taken)
            self._compare_orders(max(self._taken, key=lambda other: _contrast(other, taken)), taken)
        self._taken.append(taken)

    def _compare_turns(self, before: _Taken, after: _Taken) -> None:
        """Hold the turn between two scans' readings against odometry's between them, at OFFSETS."""
        turns = normalize_angles(after.headings - before.headings)
        if np.ptp(turns) < LEAST_CHANGE or np.abs(turns).max() > math.radians(FARTHEST_TURN):
            return
        turn = _turn_between(before.readings, after.readings, turns)
        if turn is not None:
            self._errors.append(np.minimum(np.abs(turns - turn), LARGEST_ERROR) ** 2)
            self._date(self._told())

    def _date(self, late: Optional[float]) -> None:
        """Go by another offset (s) where one is told."""
        if late is None:
            return
        if abs(late - (self.late or 0.0)) > NEARLY:
            self._contrasts = 0
            self._votes[:] = 0  # scans were laid on each other as odometry had it at another time
        self.late = late

    def _told(self) -> Optional[float]:
        if len(self._errors) < FEWEST_PAIRS:
            return None
        errors = np.array(self._errors)
        means = errors.mean(axis=0)
        best, none = int(means.argmin()), int(np.abs(OFFSETS).argmin())
        if means[best] > FITS ** 2:
            return None
        gains = (errors[:, none] - errors[:, best]) / (2.0 * max(NOISE ** 2, means[best]))
        if np.clip(gains, -MOST_OF_ONE, MOST_OF_ONE).sum() < CERTAIN:
            return 0.0
        offset = float(OFFSETS[best])
        if 0 < best < len(OFFSETS) - 1:  # squares of turns grow as a parabola with the offset
            before, least, after = (float(mean) for mean in means[best - 1:best + 2])
            bend = before - 2.0 * least + after
            offset += 0.5 * STEP * (before - after) / bend if bend > 0.0 else 0.0
        return round(offset, 2)

    def _compare_orders(self, before: _Taken, after: _Taken) -> None:
        """Lay two scans, one of them taken in a turn, on each other with their beams taken in each of ORDERS."""
        if _contrast(before, after) < DIFFERENT or self._votes.max() >= ENOUGH:
            return
        found = [_difference(before, after, order) for order in ORDERS]
        self._contrasts += math.isfinite(min(found))
        best, second = sorted(range(len(ORDERS)), key=found.__getitem__)[:2]
        if found[best] > min(SIMILAR, CLEARER * found[second]):
            return
        self._votes[best] += 1
        votes, others = self._votes[best], np.delete(self._votes, best).max()
        if votes >= max(others + LEAD, SPEAKING * self._contrasts):
            if ORDERS[best] != (self.order or AT_ONCE):
                self._errors.clear()  # of turns between scans as another order has them
                self._taken.clear()
            self.order = ORDERS[best]


def _contrast(one: _Taken, other: _Taken) -> float:
    """Return by how much (rad) the robot turned more while one scan was taken than while the other was."""
    return abs(one.moved.theta - other.moved.theta)


def _difference(before: _Taken, after: _Taken, order: Order) -> float:
    """Return by how much (m) the readings of two scans differ, laid on each other; infinity where there are too few."""
    one = _seen_in_order(before, order, after.pose.relative_to(before.pose))
    other = _seen_in_order(after, order, IDENTITY)
    means = _differences(one, other, NEARBY)
    return math.inf if means is None else float(means.min())


def _seen_in_order(taken: _Taken, order: Order, seen_from: Pose2D) -> np.ndarray:
    """Return what comes back in DIRECTIONS (m), NaN for nothing, of a scan whose beams were taken in an order."""
    directions, ranges = ends(taken.scan, order, taken.moved, seen_from)
    hit = taken.scan.hit
    if not hit.any():
        return np.full(len(DIRECTIONS), np.nan)
    return resampled(directions[hit], ranges[hit], DIRECTIONS, max(STRIDE, REACH * abs(taken.scan.angle_increment)))


def _readings(scan: LaserScan) -> np.ndarray:
    """Return what a scan reads in DIRECTIONS (m): its reach where nothing came back, NaN where nothing was measured."""
    readings = scan.readings_at(DIRECTIONS)
    with np.errstate(invalid="ignore"):
        return np.where(readings >= scan.range_min, np.minimum(readings, scan.range_max), np.nan)


def _differences(before: np.ndarray, after: np.ndarray, turned: np.ndarray) -> Optional[np.ndarray]:
    """Return by how much two scans' readings, each of shape (D,), differ after some turns (m), shape (T,).

    None where at some turn too few directions are read in both; `turned` is TURNED of the turns, shape (T, D).
    """
    with np.errstate(invalid="ignore"):
        differences = np.minimum(np.abs(before[turned] - after), LARGEST_ERROR)
    both = np.count_nonzero(~np.isnan(differences), axis=1)
    return None if both.min() < FEWEST_BEAMS else np.nansum(differences, axis=1) / both


def _turn_between(before: np.ndarray, after: np.ndarray, expected: np.ndarray) -> Optional[float]:
    """Return the turn (rad) that lays one scan's readings on the next one's, both of shape (D,); None where unclear.

    It is looked for round those that are expected (rad), of any shape.
    """
    tried = slice(*np.searchsorted(TURNS, np.degrees((expected.min(), expected.max())) + (-ASIDE, ASIDE)))
    turns, means = TURNS[tried], _differences(before, after, TURNED[tried])
    if means is None:
        return None
    best = int(means.argmin())
    others = means[np.abs(turns - turns[best]) > LIKEWISE]
    if means[best] > SIMILAR or means[best] > CLEARER * others.min():
        return None
    return math.radians(float(turns[best]))
