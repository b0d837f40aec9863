"""What a lidar has seen that has since come nearer to it than it can measure."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

SOON = 0.5
"""Metres beyond range_min within which what is seen may be nearer than that by the next scan."""
APART = 0.1
"""Metres by which a beam must read more than the way to a thing to have looked past it, and by which the way may have
grown since nobody saw it."""
SIZE = 0.05
"""Metres to either side of a point that was seen which are the same thing's."""
CELL = 0.02
"""Metres within which points are one, where there are many."""
MANY = 1000
"""Points from which on those are left out."""


class NearThings:
    """Remembers the points of a lidar's scans that are about to become too near, until a beam looks past them."""

    def __init__(self) -> None:
        self._points = np.empty((0, 2))  # in a frame that stands (m)

    def hides(self, scan: LaserScan, sensor_pose: Pose2D) -> np.ndarray:
        """Take the next scan and return which of its beams look at such a thing, bool of shape (B,).

        Args:
            scan: It, seen from above.
            sensor_pose: The lidar in a frame that stands.
        """
        hidden = self._hidden(scan, sensor_pose)
        seen = sensor_pose.transform_points(scan.hit_points[scan.ranges[scan.hit] < scan.range_min + SOON])
        if len(self._points) > MANY:
            _, first = np.unique(np.round(self._points / CELL), axis=0, return_index=True)
            self._points = self._points[np.sort(first)[-MANY:]]
        self._points = np.concatenate((self._points, seen))
        return hidden

    def _hidden(self, scan: LaserScan, sensor_pose: Pose2D) -> np.ndarray:
        """Forget what is not there any more, or not that near, and return which beams look at the rest."""
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
