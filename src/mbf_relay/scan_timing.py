"""Estimation of a lidar's time offset and order of beams from scans and odometry, and correction of its scans."""

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
"""Time (s) between two offsets."""
OFFSETS = np.arange(-12, 13) * STEP
"""Time offsets (s) that are tried: positive where stamps are late."""
STRIDE = math.radians(1.0)
DIRECTIONS = STRIDE * np.arange(-180.0, 180.0)
"""Directions (rad) in which two scans are compared, STRIDE apart, shape (360,)."""
MARGIN, PATIENCE = 0.1, 0.5
"""Usual and largest delay (s) of odometry behind scans of the same stamp; later it is taken for missing."""
BETWEEN, POSES = 0.1, 50
"""Time (s) between odometry poses, and number of the newest that are kept: those around two scans a second apart."""
NEARLY = 0.06
"""Difference (s) up to which two offsets count as the same."""
SPACING = 0.15
"""Smallest time (s) between compared scans: between those of a fast lidar the robot hardly turns."""
MISSING = 1.0
"""Time (s) without a scan after which the comparison starts again."""
SET_BACK = 3.0
"""Time (s) by which a stamp must go back for the clock to have been set; otherwise the scan is only late."""
FARTHEST_TURN = 52
"""Largest turn (degrees) between two scans: a TurtleBot3 at its top turn rate makes 33."""
LEAST_CHANGE = 0.1
"""Smallest difference (rad) between odometry's turns at different offsets for which two scans are compared."""
TURNS = np.arange(-FARTHEST_TURN, FARTHEST_TURN + 1)
"""Turns (degrees) between two scans that are tried, shape (T,)."""
TURNED = (np.arange(len(DIRECTIONS)) + TURNS[:, None]) % len(DIRECTIONS)
"""Index of the direction before each of those turns for each direction after it, shape (T, D)."""
ASIDE = 12
"""Margin (degrees) around odometry's turns at all offsets in which the turn between two scans is searched."""
NEARBY = TURNED[np.abs(TURNS) <= 15]
"""Rows of TURNED up to 15 degrees: errors of odometry between two scans, as wheels slip."""
FEWEST_BEAMS = 60
"""Smallest number of directions in which both scans have a range."""
LARGEST_ERROR = 0.3
"""Largest error of a turn (rad) or of a range (m) that counts; larger ones come from people and occluding edges."""
SIMILAR = 0.08
"""Largest mean difference (m) of the ranges of two scans that match."""
CLEARER = 0.7
"""Largest ratio of the best turn's mean difference to the next best's; above it the match is ambiguous."""
LIKEWISE = 6
"""Difference (degrees) up to which two turns count as the same."""
PAIRS, FEWEST_PAIRS = 200, 20
"""Largest number of compared pairs of scans that are kept, and smallest for a result."""
NOISE = 0.02
"""Smallest standard deviation (rad) assumed of a turn between two scans."""
CERTAIN, MOST_OF_ONE = 15.0, 3.0
"""Log-likelihood ratio to no offset that an offset needs, and the largest contribution of one pair."""
FITS = 0.06
"""Largest root mean square error (rad) of the turns at the offset."""
PARTNERS = 4
"""Number of earlier scans, of which the one with the most different turn rate is compared with a new one."""
DIFFERENT = 0.06
"""Smallest difference (rad) of the robot's turns during two scans that are compared for the order of beams."""
LEAD = 4
"""Pairs by which an order must lead each other one: of some 400 in simulation, 1 voted for a wrong order."""
ENOUGH = 20
"""Votes for an order after which no more pairs are compared."""
SPEAKING = 0.25
"""Smallest share of pairs that vote for the order: where none is right, some pairs still match by chance."""
SPACINGS = 20
"""Number of intervals between scans whose median is the period of a lidar's turn."""
OUT_OF, NEARLY_WHOLE = 10, 0.1
"""Scans of which a throttle passes one, at most; and how far from a whole number the spacing over the driver's own time
for a scan may be, as a share: drivers fill that in carelessly, and what is no throttle's doing is not believed."""
LATELY = 0.1
"""Time (s) over which the lidar's velocity is taken from odometry."""
FARTHEST_MOVED = 0.5
"""Largest motion (m or rad) of a lidar in LATELY; more means that odometry was reset."""


class _Dated(NamedTuple):
    """A pose by odometry at a time (s), with an unwrapped heading (rad); NaN where it is not known."""

    time: float
    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class _Taken:
    """A scan with its odometry.

    Attributes:
        scan: The scan.
        headings: Odometry's headings (rad) at the stamp less each of OFFSETS, shape (25,).
        pose: Of the lidar at the middle beam, in the odometry frame.
        moved: Motion of the lidar during the sweep, in its frame at the start.
        order: Order of the beams, as far as it is known.
    """

    scan: LaserScan
    headings: np.ndarray
    pose: Pose2D
    moved: Pose2D
    order: Order

    @cached_property
    def readings(self) -> np.ndarray:
        """Motion-compensated ranges (m) in DIRECTIONS, computed on demand."""
        return _readings(
            self.scan if self.order == AT_ONCE else seen_at_once(self.scan, self.order, self.moved))


class ScanTiming:
    """Estimates the time offset and the order of beams of one lidar, without a map or a pose.

    Offset: two scans in a row show the angle by which the robot turned between them. Where clocks differ, or a driver
    stamps scans when they are sent, odometry has turned by that angle earlier or later.

    Order: a spinning lidar takes 0.1 to 0.2 s for a scan. If the robot turns meanwhile, the scan is stretched or
    compressed, depending on whether lidar and robot turn in opposite directions. A scan taken in a turn matches one
    taken without only if the order of beams is known, which messages do not tell: the drivers of the LDS-01 and of
    RPLidars send the last beam first.

    Attributes:
        late: Time (s) by which stamps are later than odometry's time of the middle beam; None while not known.
        order: Order of the beams; None while not known.
    """

    def __init__(self) -> None:
        self.late: Optional[float] = None
        self.order: Optional[Order] = None
        self._stamps: Deque[float] = collections.deque(maxlen=SPACINGS + 1)
        self._waiting: Deque[LaserScan] = collections.deque()
        self._taken: Deque[_Taken] = collections.deque(maxlen=PARTNERS)
        self._poses: Deque[_Dated] = collections.deque(maxlen=POSES)
        self._heading = 0.0  # (rad) the newest known, unwrapped
        self._errors: Deque[np.ndarray] = collections.deque(maxlen=PAIRS)  # squared errors (rad^2) of turns at OFFSETS
        self._votes = np.zeros(len(ORDERS), dtype=int)  # of pairs of scans, for each of ORDERS
        self._contrasts = 0

    def corrected(self, scan: LaserScan, pose_at: Callable[[float], Pose2D]) -> LaserScan:
        """Return a scan as if all its beams had been taken at once, stamped in odometry's time.

        Args:
            scan: The scan, with angles counter-clockwise as seen from above.
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
            scan: The scan as received, with angles counter-clockwise as seen from above.
            pose_at: Returns the lidar's pose by odometry at a time (s), or raises TransformError; called with times up
                to the largest of OFFSETS before and after a scan, once they have passed.
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
        """Record odometry poses up to a time (s), from the earliest time of the first waiting scan on."""
        time = self._poses[-1].time + BETWEEN if self._poses else self._waiting[0].stamp - OFFSETS[-1]
        while time <= until:
            try:
                pose = pose_at(time)
                self._heading += angle_between(self._heading, pose.theta)
                self._poses.append(_Dated(time, pose.x, pose.y, self._heading))
            except TransformError:
                if time > until - PATIENCE:
                    return  # it may still come
                self._poses.append(_Dated(time, math.nan, math.nan, math.nan))
            time += BETWEEN

    def _sweep_time(self, scan: LaserScan) -> float:
        """Return the time (s) from the first beam of a scan to its last for a spinning lidar.

        It turns once between two scans, or several times where scans are throttled, which the driver's own sweep time
        tells.
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
        """Compare a scan with those before it."""
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
        """Compare the turn between two scans with odometry's between them at each of OFFSETS."""
        turns = normalize_angles(after.headings - before.headings)
        if np.ptp(turns) < LEAST_CHANGE or np.abs(turns).max() > math.radians(FARTHEST_TURN):
            return
        turn = _turn_between(before.readings, after.readings, turns)
        if turn is not None:
            self._errors.append(np.minimum(np.abs(turns - turn), LARGEST_ERROR) ** 2)
            self._date(self._told())

    def _date(self, late: Optional[float]) -> None:
        """Take an offset (s), unless None."""
        if late is None:
            return
        if abs(late - (self.late or 0.0)) > NEARLY:
            self._contrasts = 0
            self._votes[:] = 0  # they were counted with odometry at another offset
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
        """Match two scans of different turn rates under each of ORDERS, and vote for the best."""
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
    """Return the difference (rad) between the robot's turns during two scans."""
    return abs(one.moved.theta - other.moved.theta)


def _difference(before: _Taken, after: _Taken, order: Order) -> float:
    """Return the mean difference (m) of two scans' ranges once matched under an order; infinity for too few ranges."""
    one = _seen_in_order(before, order, after.pose.relative_to(before.pose))
    other = _seen_in_order(after, order, IDENTITY)
    means = _differences(one, other, NEARBY)
    return math.inf if means is None else float(means.min())


def _seen_in_order(taken: _Taken, order: Order, seen_from: Pose2D) -> np.ndarray:
    """Return a scan's ranges (m) in DIRECTIONS, motion-compensated under an order; NaN without a return."""
    directions, ranges = ends(taken.scan, order, taken.moved, seen_from)
    hit = taken.scan.hit
    if not hit.any():
        return np.full(len(DIRECTIONS), np.nan)
    return resampled(directions[hit], ranges[hit], DIRECTIONS, max(STRIDE, REACH * abs(taken.scan.angle_increment)))


def _readings(scan: LaserScan) -> np.ndarray:
    """Return a scan's ranges (m) in DIRECTIONS: range_max without a return, NaN where invalid."""
    readings = scan.readings_at(DIRECTIONS)
    with np.errstate(invalid="ignore"):
        return np.where(readings >= scan.range_min, np.minimum(readings, scan.range_max), np.nan)


def _differences(before: np.ndarray, after: np.ndarray, turned: np.ndarray) -> Optional[np.ndarray]:
    """Return the mean differences (m) of two scans' ranges, shape (D,) each, after some turns, shape (T,).

    None where at some turn fewer than FEWEST_BEAMS directions have both; `turned` are rows of TURNED, shape (T, D).
    """
    with np.errstate(invalid="ignore"):
        differences = np.minimum(np.abs(before[turned] - after), LARGEST_ERROR)
    both = np.count_nonzero(~np.isnan(differences), axis=1)
    return None if both.min() < FEWEST_BEAMS else np.nansum(differences, axis=1) / both


def _turn_between(before: np.ndarray, after: np.ndarray, expected: np.ndarray) -> Optional[float]:
    """Return the turn (rad) that best matches two scans' ranges, shape (D,) each; None where it is ambiguous.

    It is searched up to ASIDE around the `expected` turns (rad), of any shape.
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
