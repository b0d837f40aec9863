"""Whether a lidar's scans are dated by the same time as odometry, told from how both turn."""

from __future__ import annotations

import collections
import math
from typing import Callable, Deque, Optional, Tuple

import numpy as np

from mbf_relay.geometry import angle_between, normalize_angles
from mbf_relay.outcomes import TransformError
from mbf_relay.scan import LaserScan

STEP = 0.05
"""Seconds from one time at which odometry is asked for its heading to the next, and from one offset to the next."""
OFFSETS = np.arange(-12, 13) * STEP
"""Seconds by which scans may be dated late, or early where negative, that are told from each other."""
DIRECTIONS = np.radians(np.arange(-180.0, 180.0))
"""Directions in which two scans are held against each other, by a degree."""
MARGIN = 0.1
"""Seconds by which odometry may come after a scan that is dated alike."""
HEADINGS = 100
"""Of odometry, the newest that are remembered: those round two scans a second apart."""
SPACING = 0.15
"""Seconds between the scans that are compared: a quick lidar's next one is hardly turned, and would tell nothing."""
MISSING = 1.0
"""Seconds without a scan after which the next one is compared with none before."""
FARTHEST_TURN = 52
"""Degrees from one scan to the next, at most: a TurtleBot3 at its top turn rate comes 33 between two scans."""
LEAST_CHANGE = 0.1
"""Radians that odometry must have turned more at one offset than at another for two scans to tell anything."""
TURNS = np.arange(-FARTHEST_TURN, FARTHEST_TURN + 1)
"""Turns between two scans that are tried (degrees)."""
TURNED = (np.arange(len(DIRECTIONS)) + TURNS[:, None]) % len(DIRECTIONS)
"""Of each direction, after each of those turns, the one it was before, shape (T, D)."""
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
CERTAIN = 5.0
"""Standard errors by which the offset must fit better than none."""
FITS = 0.06
"""Radians, root mean square, within which turns must agree at the offset."""


class ScanTiming:
    """Compares the turns of one lidar's scans with those of odometry at the times they are dated, and at others.

    It needs neither a map nor a pose: two scans in a row tell by which angle the robot turned between them, odometry
    when. Where clocks differ, or a driver dates scans when they are sent, odometry turns before or after what the lidar
    sees does, walls stand askew in a turn, and localization looks for the robot where it is not.

    Attributes:
        late: Seconds by which scans are dated later than they are taken, by odometry's time; None where nothing tells.
    """

    def __init__(self) -> None:
        self.late: Optional[float] = None
        self._waiting: Deque[Tuple[float, np.ndarray]] = collections.deque()  # stamps and readings of scans
        self._headings: Deque[Tuple[float, float]] = collections.deque(maxlen=HEADINGS)  # times; NaN where not known
        self._heading = 0.0  # the newest known, turns counted
        self._errors: Deque[np.ndarray] = collections.deque(maxlen=PAIRS)

    def take(self, scan: LaserScan, heading_at: Callable[[float], float]) -> None:
        """Take the next scan.

        Args:
            scan: It, seen from above.
            heading_at: Gives odometry's heading (rad) at a time (s), or raises TransformError; asked for times as long
                before and after a scan as OFFSETS reach, once those have passed.
        """
        if self._waiting:
            since = scan.stamp - self._waiting[-1][0]
            if 0.0 <= since < SPACING:
                return
            if not 0.0 <= since < MISSING:  # the clock was set, or scans are lost
                self._waiting.clear()
                self._headings.clear()
        self._waiting.append((scan.stamp, _readings(scan)))
        self._follow(scan.stamp - MARGIN, heading_at)
        while len(self._waiting) > 2 and self._waiting[1][0] + OFFSETS[-1] <= self._headings[-1][0]:
            (stamp_before, before), (stamp, after) = self._waiting.popleft(), self._waiting[0]
            times, headings = np.array(self._headings).T
            turns = np.interp(stamp - OFFSETS, times, headings) - np.interp(stamp_before - OFFSETS, times, headings)
            if not np.isnan(turns).any():
                self._compare(before, after, normalize_angles(turns))

    def _follow(self, until: float, heading_at: Callable[[float], float]) -> None:
        """Ask odometry for its headings up to a time (s), from where the first scan that waits may be dated to."""
        time = self._headings[-1][0] + STEP if self._headings else self._waiting[0][0] - OFFSETS[-1]
        while time <= until:
            try:
                self._heading += angle_between(self._heading, heading_at(time))
                self._headings.append((time, self._heading))
            except TransformError:
                self._headings.append((time, math.nan))
            time += STEP

    def _compare(self, before: np.ndarray, after: np.ndarray, turns: np.ndarray) -> None:
        """Hold two scans' readings against odometry's turns (rad) between them at OFFSETS."""
        if np.ptp(turns) < LEAST_CHANGE or np.abs(turns).max() > math.radians(FARTHEST_TURN):
            return
        turn = _turn_between(before, after)
        if turn is not None:
            self._errors.append(np.minimum(np.abs(turns - turn), LARGEST_ERROR) ** 2)
            self.late = self._told()

    def _told(self) -> Optional[float]:
        if len(self._errors) < FEWEST_PAIRS:
            return None
        errors = np.array(self._errors)
        means = errors.mean(axis=0)
        best, none = int(means.argmin()), int(np.abs(OFFSETS).argmin())
        if means[best] > FITS ** 2:
            return None
        gain = errors[:, none] - errors[:, best]
        certain = gain.mean() >= CERTAIN * gain.std() / math.sqrt(len(gain))
        return float(OFFSETS[best]) if certain else 0.0


def _readings(scan: LaserScan) -> np.ndarray:
    """Return what a scan reads in DIRECTIONS (m): its reach where nothing came back, NaN where nothing was measured."""
    readings = scan.readings_at(DIRECTIONS)
    with np.errstate(invalid="ignore"):
        return np.where(readings >= scan.range_min, np.minimum(readings, scan.range_max), np.nan)


def _turn_between(before: np.ndarray, after: np.ndarray) -> Optional[float]:
    """Return the turn (rad) that lays one scan's readings on the next one's, both of shape (D,); None where unclear."""
    with np.errstate(invalid="ignore"):
        differences = np.minimum(np.abs(before[TURNED] - after), LARGEST_ERROR)
    both = np.count_nonzero(~np.isnan(differences), axis=1)
    if both.min() < FEWEST_BEAMS:
        return None
    means = np.nansum(differences, axis=1) / both
    best = int(means.argmin())
    others = means[np.abs(TURNS - TURNS[best]) > LIKEWISE]
    if means[best] > SIMILAR or means[best] > CLEARER * others.min():
        return None
    return math.radians(float(TURNS[best]))
