"""A planar laser scan, as used by localization, costmaps and the simulated lidar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

NEAREST = float(np.finfo(np.float32).tiny)
"""Smallest range_min (m): with it a reading of 0 is always invalid, also where a driver sends range_min 0."""


@dataclass(frozen=True)
class LaserScan:
    """One sweep of a planar lidar, in the sensor's frame; treat as read-only.

    Attributes:
        ranges: Shape (B,) in metres; +inf where nothing came back, NaN or below `range_min` where the reading is
            invalid.
        angle_min: Direction (rad) of the first beam, counter-clockwise from the sensor's x axis.
        angle_increment: Angle (rad) from one beam to the next.
        range_min, range_max: Readings (m) outside of these are no measurements. A range_min of 0 becomes NEAREST.
        stamp: Time (s) of the scan.
        frame: Name of the sensor's frame.
        sweep_time: Time (s) from the first beam to the last, 0 where the driver does not tell, or tells two.
    """

    ranges: np.ndarray
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    stamp: float
    frame: str = "base_scan"
    sweep_time: float = 0.0

    def __post_init__(self) -> None:
        if self.range_min == 0.0:
            object.__setattr__(self, "range_min", NEAREST)

    @cached_property
    def angles(self) -> np.ndarray:
        """Directions of the beams, shape (B,) in radians."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges))

    @property
    def goes_round(self) -> bool:
        """Whether it covers a full turn, so that the last beam and the first are neighbours."""
        step = abs(self.angle_increment)
        return len(self.ranges) * step > 2.0 * math.pi - 1.5 * step

    @cached_property
    def measured(self) -> np.ndarray:
        """Which beams are valid, bool of shape (B,): range_min or more, infinity included; not NaN."""
        with np.errstate(invalid="ignore"):
            enough: np.ndarray = self.ranges >= self.range_min
        return enough

    @cached_property
    def hit(self) -> np.ndarray:
        """Which beams have a return: range_min or more, and below range_max, bool of shape (B,)."""
        with np.errstate(invalid="ignore"):
            within: np.ndarray = self.measured & (self.ranges < self.range_max)
        return within

    def readings_at(self, angles: np.ndarray) -> np.ndarray:
        """Return the ranges (m) of the beams nearest to some directions (rad), both (A,); NaN outside of the scan.

        With it two scans are compared by direction: the number of beams of a spinning lidar varies from turn to turn.
        """
        size, step = len(self.ranges), abs(self.angle_increment) or 2.0 * math.pi
        off = (angles - self.angle_min) * math.copysign(1.0, self.angle_increment)
        beams = (np.mod(off + 0.5 * step, 2.0 * math.pi) / step).astype(np.int64)
        looks = (beams < size) | self.goes_round
        return np.where(looks, self.ranges[np.minimum(beams, size - 1)], np.nan)

    @property
    def hit_points(self) -> np.ndarray:
        """Ends of the beams with a return, shape (H, 2) in metres, in the sensor's frame."""
        hit = self.hit
        ranges, angles = self.ranges[hit], self.angles[hit]
        return np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
