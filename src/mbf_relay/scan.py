"""A planar laser scan: what the lidar measures, localization weighs and costmaps mark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LaserScan:
    """One sweep of a planar lidar, in the sensor's frame.

    Attributes:
        ranges: Shape (B,) in metres; +inf where nothing came back, NaN or below `range_min` where the reading is
            invalid.
        angle_min: Direction (rad) of the first beam, counter-clockwise from the sensor's x axis.
        angle_increment: Angle (rad) from one beam to the next.
        range_min, range_max: Readings (m) outside of these are no measurements.
        stamp: Time (s) of the scan.
        frame: Name of the sensor's frame.
    """

    ranges: np.ndarray
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    stamp: float
    frame: str = "base_scan"

    @property
    def angles(self) -> np.ndarray:
        """Directions of the beams, shape (B,) in radians."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges))

    @property
    def hit(self) -> np.ndarray:
        """Which beams came back from something within the lidar's reach, bool of shape (B,)."""
        with np.errstate(invalid="ignore"):
            within: np.ndarray = (self.ranges >= self.range_min) & (self.ranges < self.range_max)
        return within

    @property
    def hit_points(self) -> np.ndarray:
        """Where those beams ended, shape (H, 2) in metres."""
        hit = self.hit
        ranges, angles = self.ranges[hit], self.angles[hit]
        return np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
