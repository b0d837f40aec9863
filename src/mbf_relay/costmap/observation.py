"""Observations: the form in which laser scans and point clouds are given to a costmap, in its frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.outline import are_own
from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

MISS_MARGIN = 1e-3
"""Metres below range_max within which readings are misses: some drivers report "no return" slightly below it."""


@dataclass(frozen=True)
class Observation:
    """Rays of one measurement, from one origin to many end points; compare costmap_2d's Observation.

    Attributes:
        origin: The sensor's position in the costmap's frame: (x, y) or (x, y, z) in metres.
        points: End points in the costmap's frame, shape (N, 2) or (N, 3) in metres; rows that are not finite are
            ignored. With two columns, limits on heights do not apply.
        hits: Shape (N,), bool: True where something was hit, False where the ray only shows free space. None where all
            are hits.
        stamp: Time (s) of the measurement.
        frame: The sensor's own frame, by which several sensors on one topic are told apart.
        rides: Whether the sensor is mounted on the robot. One that is fixed in the world may fall silent without making
            the costmap stale, as long as another sensor on its topic reports.
        heading: Direction (rad) of the sensor's x axis in the costmap's frame; None where not known.
        base: Pose of the robot's base in the costmap's frame at that time; None where not known.
        unseen: For beams without a valid reading, which may look at an object nearer than range_min: the points at
            range_min along them, shape (M, 2) in metres, in the costmap's frame. None for no such beams.
    """

    origin: Tuple[float, ...]
    points: np.ndarray
    hits: Optional[np.ndarray]
    stamp: float
    frame: str = ""
    rides: bool = True
    heading: Optional[float] = None
    base: Optional[Pose2D] = None
    unseen: Optional[np.ndarray] = None

    def dated(self, now: Optional[float]) -> Observation:
        """Return a copy stamped `now` (s) where its own stamp is 0, as of a sensor without a clock; else itself."""
        return self if self.stamp != 0.0 or now is None else replace(self, stamp=now)

    def without_robot(self, outline: np.ndarray) -> Observation:
        """Return it without rays that end on the robot itself; `outline` as for `are_own`."""
        if self.base is None:
            return self
        own = are_own(self.points, self.base, outline)
        if not own.any():
            return self
        return replace(self, points=self.points[~own], hits=None if self.hits is None else self.hits[~own])


def observation_from_scan(scan: LaserScan, sensor_pose: Pose2D, height: Optional[float] = None) -> Observation:
    """Return the observation of a level lidar.

    Args:
        scan: The scan.
        sensor_pose: Pose of the sensor in the costmap's frame when the scan was taken.
        height: The sensor's height (m) in the costmap's frame; None for an observation without heights.
    """
    seen = observation_from_level_points(*scan_points(scan), sensor_pose, scan.stamp, height)
    unseen = unseen_points(scan)
    return seen if unseen is None else replace(seen, unseen=sensor_pose.transform_points(unseen))


def observation_from_level_points(
    points: np.ndarray, hits: np.ndarray, sensor_pose: Pose2D, stamp: float, height: Optional[float] = None
) -> Observation:
    """Return the observation of a level lidar from its `scan_points`, which several costmaps can share.

    Args:
        points, hits: As `scan_points` returns them.
        sensor_pose, height: As for `observation_from_scan`.
        stamp: Time (s) of the scan.
    """
    ends = sensor_pose.transform_points(points)
    if height is None:
        return Observation((sensor_pose.x, sensor_pose.y), ends, hits, stamp, heading=sensor_pose.theta)
    raised = np.empty((len(ends), 3))
    raised[:, :2], raised[:, 2] = ends, height
    return Observation((sensor_pose.x, sensor_pose.y, height), raised, hits, stamp, heading=sensor_pose.theta)


def scan_points(scan: LaserScan, inf_is_valid: bool = True) -> Tuple[np.ndarray, np.ndarray]:
    """Return a scan's end points in the sensor's frame, (N, 2) in metres, and which of them are hits, (N,) bool.

    Readings below range_min or NaN are left out. Those at or above range_max and infinite ones are misses: with
    `inf_is_valid` their end points lie at range_max, without it they are left out.
    """
    ranges = scan.ranges
    with np.errstate(invalid="ignore"):  # False for NaN, of which numpy 1.17 warns
        misses = ranges >= scan.range_max - MISS_MARGIN
        hits = scan.measured & ~misses
    kept = hits | misses if inf_is_valid else hits
    lengths = np.where(misses, scan.range_max, ranges)[kept]
    angles = scan.angles[kept]
    return np.column_stack((lengths * np.cos(angles), lengths * np.sin(angles))), hits[kept]


def unseen_points(scan: LaserScan) -> Optional[np.ndarray]:
    """Return the points at range_min of beams without a valid reading: (M, 2) in metres, sensor's frame; None for none.
    """
    if scan.measured.all():
        return None
    angles = scan.angles[~scan.measured]
    return scan.range_min * np.column_stack((np.cos(angles), np.sin(angles)))


def observation_from_points(
    points: np.ndarray, hits: Optional[np.ndarray], rotation: np.ndarray, translation: np.ndarray, stamp: float
) -> Observation:
    """Return the observation of a sensor that may be tilted, such as a depth camera.

    Args:
        points: In the sensor's frame, shape (N, 2) or (N, 3) in metres.
        hits: As in Observation.
        rotation, translation: Shapes (3, 3) and (3,) in metres: the transform from the sensor's frame to the costmap's.
        stamp: Time (s) of measurement.
    """
    if hits is None and points.shape[1] == 3:
        ends = np.empty((len(points), 3))
        ends = ends[:layer_kernels.turn_cloud(
            np.ascontiguousarray(points, float), np.ascontiguousarray(rotation), np.ascontiguousarray(translation),
            ends)]
    else:
        ends = points @ rotation[:, :points.shape[1]].T + translation
    x, y, z = map(float, translation)
    return Observation((x, y, z), ends, hits, stamp, heading=math.atan2(rotation[1, 0], rotation[0, 0]))
