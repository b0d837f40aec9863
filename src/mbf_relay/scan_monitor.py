"""Whether a scan shows anything: a lidar that delivers nothing must not count as seeing nothing in the way."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.near_things import NearThings
from mbf_relay.scan import LaserScan

LARGEST_GAP = 0.35
"""Radians side by side in which a lidar may measure nothing: they hide 6 cm where the robot must have stopped."""
AHEAD = math.pi / 3.0
"""Radians to either side of straight ahead in which there must be no such gap; what masks a robot's rear may be wider.
"""
NEAR = 0.1
"""Metres beyond range_min: between beams that read so little, those that read nothing look at something nearer still.
"""
USABLE = 0.1
"""Share of the beams that must measure something, wherever they look."""
MOVED = 0.03
"""Metres or radians after which the same readings again are old ones."""
SEEN_BEFORE = 0.5 * math.pi
"""Radians full of returns after which a scan without any is not believed: a robot does not leave walls at once, unless
it looks no wider than that, as by a depth camera.
"""
SCATTERED = 6
"""Gaps in a scan from which on they are how its driver speaks of what is too far away, too dark or seen too flatly:
what covers a lidar, or has died in it, makes one or two, and four posts of a robot mask as many.
"""


class ScanMonitor:
    """Judges the scans of one lidar, one after the other.

    A beam measured something where it reads range_min or more, infinity included: that says nothing is there. Drivers
    that have no such word, as that of a TurtleBot3's LDS-01, which sends 0, leave gaps wherever it is far to the next
    wall; move_base drives on in them, and so it is here, while the scan has several and has never read infinity. Nor is
    there a gap where the lidar has seen something that is now nearer than it can measure: costmaps keep that.

    Args:
        largest_gap: See LARGEST_GAP; 0 for a lidar whose zeros say that nothing is there. Its gaps are then not looked
            at.

    Attributes:
        takes_gaps_for_far: Whether a gap ahead was, in any scan so far.
    """

    def __init__(self, largest_gap: float = LARGEST_GAP) -> None:
        self._largest_gap = largest_gap
        self._first: Optional[Tuple[LaserScan, Pose2D]] = None  # of those with the same readings, and from where
        self._near_things = NearThings()
        self._seen = 0.0  # radians full of returns in the last scan that was believed
        self.takes_gaps_for_far = False
        self._says_nothing_is_there = False  # by infinity, as REP 117 asks for; in any scan so far

    def trouble(self, scan: LaserScan, forward: float, sensor_pose: Pose2D) -> Optional[str]:
        """Return why a scan must not be driven on, or None.

        Args:
            scan: The scan, seen from above.
            forward: Direction (rad) of the robot's front among the scan's angles.
            sensor_pose: The sensor in a frame that stands, which tells whether it has moved.
        """
        hit, hidden = scan.hit, self._near_things.hides(scan, sensor_pose)
        found = self._frozen(scan, hit, sensor_pose) or self._blind(scan, scan.measured | hidden, forward)
        seen = float(np.count_nonzero(hit)) * abs(scan.angle_increment)
        if found is None and seen == 0.0 and self._seen >= SEEN_BEFORE:
            found = "the lidar sees nothing at all any more, and there were walls in the last scan"
        if found is None:
            self._seen = seen
        return found

    def _frozen(self, scan: LaserScan, returns: np.ndarray, pose: Pose2D) -> Optional[str]:
        if self._first is None or self._first[0].ranges.tobytes() != scan.ranges.tobytes():
            self._first = scan, pose
            return None
        if not returns.any():
            return None
        moved = pose.distance_to(self._first[1])
        turned = abs(angle_between(pose.theta, self._first[1].theta))
        if max(moved, turned) <= MOVED:
            return None
        return f"the lidar repeats the same readings although it moved {moved:.2f} m and {turned:.2f} rad"

    def _blind(self, scan: LaserScan, usable: np.ndarray, forward: float) -> Optional[str]:
        if self._largest_gap <= 0.0:
            return None
        measured, step = int(np.count_nonzero(usable)), abs(scan.angle_increment)
        share = measured / max(1, len(usable))
        if share < USABLE:
            return f"the lidar measures nothing in {100.0 * (1.0 - share):.0f} % of its beams"
        width = len(usable) * step
        if width < self._largest_gap:
            return (f"the lidar looks into {math.degrees(width):.0f} degrees in all; what lies beside counts as free, "
                    f"and more than {math.degrees(self._largest_gap):.0f} may not go unseen")
        self._says_nothing_is_there |= bool(np.isposinf(scan.ranges).any())
        if measured == len(usable):
            return None
        unseen = gaps(usable, scan.goes_round)
        is_its_word = len(unseen) >= SCATTERED and not self._says_nothing_is_there
        allowed = math.floor(self._largest_gap / step) if step > 0.0 else len(usable)
        for first, count in unseen:
            if count <= allowed or _explained(scan, first, count):
                continue
            middle = scan.angle_min + scan.angle_increment * (first + (count - 1) / 2.0)
            off = abs(math.remainder(middle - forward, 2.0 * math.pi))
            if off - count * step / 2.0 >= AHEAD:
                continue
            if not is_its_word:
                return (f"the lidar measures nothing in {math.degrees(count * step):.0f} degrees ahead; "
                        f"at most {math.degrees(self._largest_gap):.0f} are allowed, and all where its source has "
                        "largest_gap: 0.0, for drivers that say so of what is too far away")
            self.takes_gaps_for_far = True
        return None


def gaps(usable: np.ndarray, closed: bool) -> list[tuple[int, int]]:
    """Return runs of beams that are not usable as (first, count); over the end of a scan of a full turn where `closed`.
    """
    size = len(usable)
    if usable.all():
        return []
    if not usable.any():
        return [(0, size)]
    start = int(np.argmax(usable)) if closed else 0
    rolled = np.concatenate((np.roll(usable, -start), [True]))
    edges = np.diff(np.concatenate(([1], rolled.astype(np.int8))))
    firsts, ends = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    return [((int(first) + start) % size, int(end - first)) for first, end in zip(firsts, ends)]


def _explained(scan: LaserScan, first: int, count: int) -> bool:
    """Return whether a gap lies between beams that see something near: then it hides what is nearer than range_min."""
    size, limit = len(scan.ranges), scan.range_min + NEAR
    if not scan.goes_round and (first == 0 or first + count == size):
        return False  # no beam looks beside it
    sides = [scan.ranges[index % size] for index in (first - 1, first + count)]
    return bool(all(scan.range_min <= side <= limit for side in sides))  # whose own beam is no gap that is hidden
