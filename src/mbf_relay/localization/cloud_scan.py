"""Conversion of a point cloud to a scan: the nearest point in each direction, as pointcloud_to_laserscan does.

A direction without a point becomes NaN (no reading), not infinity (nothing there): a camera sees only a part of its
surroundings, and a lidar with several rings misses what stands between two of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.scan import LaserScan


@dataclass(frozen=True)
class CloudParameters(ParameterSet):
    """Parameters of point clouds that localization takes as scans (group `cloud` of amcl)."""

    min_height: float = parameter(
        0.1, "points lower than this above the base frame's origin are ignored, such as the floor", unit="m")
    max_height: float = parameter(
        1.0, "points higher than this are ignored; the map should show what stands between both heights", unit="m")
    angle_min: float = parameter(
        -math.pi, "first direction, from the base frame's x axis", unit="rad", minimum=-math.pi, maximum=math.pi)
    angle_max: float = parameter(math.pi, "last direction", unit="rad", minimum=-math.pi, maximum=math.pi)
    angle_increment: float = parameter(
        math.pi / 360.0, "angle between two directions; the nearest point of each is taken", unit="rad", minimum=1e-3,
        maximum=math.pi / 2.0)
    range_min: float = parameter(0.0, "nearer points are ignored, such as the robot's own", unit="m", minimum=0.0)
    range_max: float = parameter(100.0, "farther points are ignored", unit="m", above=0.0, maximum=1e4)

    def check(self) -> None:
        for low, high in (("min_height", "max_height"), ("angle_min", "angle_max"), ("range_min", "range_max")):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(
                    f"parameter {low} is {getattr(self, low)}; it must be below {high} {getattr(self, high)}"
                )


def scan_of_points(
    points: np.ndarray, sensor: np.ndarray, values: CloudParameters, stamp: float, frame: str
) -> LaserScan:
    """Return a cloud as a scan in a frame whose origin is the sensor and whose axes are parallel to the base's.

    Args:
        points: Shape (N, 3) in metres, in the base's frame; rows that are not finite are left out.
        sensor: Position of the sensor in the base's frame, shape (2,) or more.
        values: Heights, directions and ranges that are used.
        stamp: Time (s) of the cloud.
        frame: Name of the sensor's frame.
    """
    forward, left = points[:, 0] - sensor[0], points[:, 1] - sensor[1]
    ranges, bearings = np.hypot(forward, left), np.arctan2(left, forward)
    taken = (
        (points[:, 2] >= values.min_height) & (points[:, 2] <= values.max_height)  # False for NaN
        & (ranges > values.range_min) & (ranges <= values.range_max)
        & (bearings >= values.angle_min) & (bearings <= values.angle_max)
    )
    count = max(1, math.ceil(round((values.angle_max - values.angle_min) / values.angle_increment, 6)))
    ranges = ranges[taken]
    directions = ((bearings[taken] - values.angle_min) / values.angle_increment).astype(np.int64)
    farthest_first = np.argsort(-ranges, kind="stable")
    nearest = np.full(count, np.nan)
    nearest[np.minimum(directions, count - 1)[farthest_first]] = ranges[farthest_first]
    return LaserScan(
        nearest, values.angle_min + 0.5 * values.angle_increment, values.angle_increment, values.range_min,
        values.range_max, stamp, frame,
    )
