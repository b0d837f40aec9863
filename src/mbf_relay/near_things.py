"""Memory of obstacles that have come closer to a lidar than its range_min."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

SOON = 0.5
"""Distance (m) beyond range_min within which points are remembered: they may be too near by the next scan."""
APART = 0.1
"""Distance (m) by which a beam must read more than a point's distance to prove that the point is gone, and by which a
point may be beyond range_min while it is not seen."""
SIZE = 0.05
"""Half width (m) of the obstacle assumed around a point."""
CELL = 0.02
"""Side (m) of the cells of which each keeps one point, where there are many."""
MANY = 1000
"""Number of points above which they are thinned out."""


class NearThings:
    """Remembers points of a lidar's scans near range_min, until a beam reads farther in their direction."""

    def __init__(self) -> None:
        self._points = np.empty((0, 2))  # (m), in a fixed frame

    def hides(self, scan: LaserScan, sensor_pose: Pose2D) -> np.ndarray:
        """Take the next scan and return which of its invalid beams look at a remembered point, bool of shape (B,).

        Args:
            scan: The scan, with angles counter-clockwise as seen from above.
            sensor_pose: Of the lidar, in a fixed frame such as odom.
        """
        hidden = self._hidden(scan, sensor_pose)
        seen = sensor_pose.transform_points(scan.hit_points[scan.ranges[scan.hit] < scan.range_min + SOON])
        if len(self._points) > MANY:
            _, first = np.unique(np.round(self._points / CELL), axis=0, return_index=True)
            self._points = self._points[np.sort(first)[-MANY:]]
        self._points = np.concatenate((self._points, seen))
        return hidden

    def _hidden(self, scan: LaserScan, sensor_pose: Pose2D) -> np.ndarray:
        """Forget points that are gone or farther away, and return which invalid beams look at the others, bool (B,)."""
        size, step = len(scan.ranges), abs(scan.angle_increment)
        if len(self._points) == 0 or step == 0.0 or scan.measured.all():
            self._points = self._points[:0]
            return np.zeros(size, dtype=bool)
        local = sensor_pose.inverse().transform_points(self._points)
        near = np.hypot(local[:, 0], local[:, 1]) <= scan.range_min + APART
        if not near.any():  # as nearly always
            self._points = self._points[:0]
            return np.zeros(size, dtype=bool)
        x, y = np.ascontiguousarray(local[near].T)
        away, bearings = np.hypot(x, y), np.arctan2(y, x)
        with np.errstate(invalid="ignore"):
            there = ~(scan.readings_at(bearings) > away + APART)
        self._points, away, bearings = self._points[near][there], away[there], bearings[there]
        middle = np.remainder((bearings - scan.angle_min) * math.copysign(1.0, scan.angle_increment), 2.0 * math.pi)
        aside = np.arctan2(SIZE, away) + step
        begins = np.zeros(size + 1, dtype=np.int64)
        for turn in (-2.0 * math.pi, 0.0):  # what lies over the ends of a scan that goes round is looked at from both
            np.add.at(begins, _beams(middle - aside + turn, step, size), 1)
            np.add.at(begins, _beams(middle + aside + turn, step, size), -1)
        hidden: np.ndarray = ~scan.measured & (np.cumsum(begins)[:-1] > 0)
        return hidden


def _beams(angles: np.ndarray, step: float, size: int) -> np.ndarray:
    """Return the first beam behind each of some angles (rad) from the first beam, of `size` that are `step` apart."""
    beams: np.ndarray = np.clip(np.ceil(angles / step), 0, size).astype(np.int64)
    return beams
