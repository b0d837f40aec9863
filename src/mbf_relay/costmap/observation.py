"""What a sensor saw at one moment, in the costmap's frame: the form in which scans and point clouds reach a costmap."""

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
"""Readings this near below range_max (m) are misses: drivers report "nothing there" as range_max less a little."""


@dataclass(frozen=True)
class Observation:
    """Rays from one origin to many end points.

    Attributes:
        origin: The sensor's position in the costmap's frame: (x, y) or (x, y, z) in metres.
        points: End points in the costmap's frame, shape (N, 2) or (N, 3) in metres; rows that are not finite are left
            out. Heights are looked at only where there are three columns.
        hits: Shape (N,), bool: True where something was hit there, False where the ray only shows free space. None
            where all are hits.
        stamp: Time (s) of measurement.
        frame: The sensor's own frame, which tells it from others on the same topic.
        rides: Whether the sensor moves with the robot. One that stands in the world sees as well, and is not missed
            where others of its topic do.
        heading: Which way (rad) the sensor faces in the costmap's frame; None where that is not known.
        base: The robot's base in the costmap's frame when it was measured; None where that is not known.
        unseen: Where beams that measured nothing, as at what is nearer than range_min, begin to see: shape (M, 2) in
            metres, in the costmap's frame. None where there are none.
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
        """Return it as measured `now` (s), where that is told and it has no stamp, as from a sensor without a clock."""
        return self if self.stamp != 0.0 or now is None else replace(self, stamp=now)

    def without_robot(self, outline: np.ndarray) -> Observation:
        """Return it without what the sensor saw of the robot itself, whose outline is (K, 2) in metres, base frame."""
        if self.base is None:
            return self
        own = are_own(self.points, self.base, outline)
        if not own.any():
            return self
        return replace(self, points=self.points[~own], hits=None if self.hits is None else self.hits[~own])


def observation_from_scan(scan: LaserScan, sensor_pose: Pose2D, height: Optional[float] = None) -> Observation:
    """Return what a level lidar saw.

    Args:
        scan: The scan.
        sensor_pose: The sensor in the costmap's frame when the scan was taken.
        height: The sensor's height (m) in the costmap's frame; without it, heights are not looked at.
    """
    seen = observation_from_level_points(*scan_points(scan), sensor_pose, scan.stamp, height)
    unseen = unseen_points(scan)
    return seen if unseen is None else replace(seen, unseen=sensor_pose.transform_points(unseen))


def observation_from_level_points(
    points: np.ndarray, hits: np.ndarray, sensor_pose: Pose2D, stamp: float, height: Optional[float] = None
) -> Observation:
    """Return what a level lidar saw, from its `scan_points`, which are the same for several costmaps.

    Args:
        points, hits: See scan_points.
        sensor_pose, height: As for observation_from_scan.
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

    Readings below range_min or NaN are left out. Those at or above range_max and infinite ones are no hits: they stay,
    at range_max, where `inf_is_valid`, and are left out otherwise.
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
    """Return where beams that measured nothing begin to see, shape (M, 2) in metres in the sensor's frame, or None."""
    if scan.measured.all():
        return None
    angles = scan.angles[~scan.measured]
    return scan.range_min * np.column_stack((np.cos(angles), np.sin(angles)))


def observation_from_points(
    points: np.ndarray, hits: Optional[np.ndarray], rotation: np.ndarray, translation: np.ndarray, stamp: float
) -> Observation:
    """Return an observation from points of a sensor that may be tilted.

    Args:
        points: In the sensor's frame, shape (N, 2) or (N, 3) in metres.
        hits: As in Observation.
        rotation, translation: Shapes (3, 3) and (3,): take points of the sensor's frame to the costmap's frame.
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
