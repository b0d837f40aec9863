"""Plausibility checks of scans: a blind, covered or frozen lidar must not count as seeing free space."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.near_things import NearThings
from mbf_relay.scan import LaserScan

LARGEST_GAP = 0.35
"""Largest angle (rad) of adjacent invalid beams: it hides 6 cm at the distance where the robot must have stopped."""
AHEAD = math.pi / 3.0
"""Angle (rad) to either side of straight ahead within which a larger gap is not allowed; the rear may be masked."""
NEAR = 0.1
"""Distance (m) beyond range_min: a gap between two beams that read less is taken for something nearer than range_min.
"""
USABLE = 0.1
"""Smallest share of valid beams in a scan."""
MOVED = 0.03
"""Motion (m or rad) above which identical readings mean that the lidar is frozen."""
SEEN_BEFORE = 0.5 * math.pi
"""Angle (rad) with returns in the last scan from which on a scan without any is refused: walls all round do not vanish
at once. A sensor of a smaller field of view, as a depth camera, may turn away from all at once.
"""
SCATTERED = 6
"""Number of gaps in a scan from which on they are taken for the driver's way to say "no return" (too far, too dark, too
flat an angle): a cover or a defect makes one or two gaps, and a robot's four posts make four.
"""


class ScanMonitor:
    """Checks the scans of one lidar, one after the other.

    A beam is valid where it reads range_min or more, infinity ("nothing there") included. Some drivers, as the LDS-01's
    of a TurtleBot3, send 0 instead and leave gaps where walls are far away. move_base drives on with them; here, too,
    gaps are accepted while a scan has SCATTERED or more and no scan so far had infinite readings. Beams towards
    something seen before and now nearer than range_min are no gap, as costmaps keep that obstacle.

    Args:
        largest_gap: See LARGEST_GAP; 0 switches the check of gaps off, for a lidar whose zeros mean "nothing there".

    Attributes:
        takes_gaps_for_far: Whether a gap ahead was accepted so in any scan.
    """

    def __init__(self, largest_gap: float = LARGEST_GAP) -> None:
        self._largest_gap = largest_gap
        self._first: Optional[Tuple[LaserScan, Pose2D]] = None  # first of several identical scans, and its pose
        self._near_things = NearThings()
        self._seen = 0.0  # angle (rad) with returns in the last accepted scan
        self.takes_gaps_for_far = False
        self._says_nothing_is_there = False  # by infinity (REP 117), in any scan so far

    def trouble(self, scan: LaserScan, forward: float, sensor_pose: Pose2D) -> Optional[str]:
        """Return why the robot must not drive by a scan, or None.

        Args:
            scan: The scan, with angles counter-clockwise as seen from above.
            forward: Direction (rad) of the robot's front in the scan's angles.
            sensor_pose: Of the sensor in a fixed frame such as odom.
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
    """Return runs of unusable beams as (first, count).

    Args:
        usable: Bool of shape (B,).
        closed: Whether the last beam and the first are neighbours, so that a run may extend over the end.
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
    """Return whether a gap lies between two near readings, so that something nearer than range_min fills it."""
    size, limit = len(scan.ranges), scan.range_min + NEAR
    if not scan.goes_round and (first == 0 or first + count == size):
        return False  # the scan ends there
    sides = [scan.ranges[index % size] for index in (first - 1, first + count)]
    return bool(all(scan.range_min <= side <= limit for side in sides))
