"""A small synthetic room, and scans of it, for the localization tests."""

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import is_free
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

ORIGIN = Pose2D(-3.0, -2.0, 0.0)


def room(origin=ORIGIN):
    """Return a room of 8 m x 6 m without symmetry."""
    data = np.zeros((120, 160), dtype=np.int8)
    data[:2] = data[-2:] = 100
    data[:, :2] = data[:, -2:] = 100
    data[40:60, 60:70] = 100
    data[90:118, 110:114] = 100
    data[20:30, 130:150] = 100
    return OccupancyMap(data, 0.05, origin)


def scan_at(occupancy, pose, rng=None, beams=180, range_max=6.0, stamp=0.0, frame="base_scan"):
    """Return what a lidar at a pose sees, with 1 cm of noise where a generator is given."""
    blocked = np.ascontiguousarray(~is_free(occupancy.data)).view(np.uint8)
    frame_of_map, ranges = np.array([*occupancy.origin, occupancy.resolution]), np.empty(beams)
    bearings = np.arange(beams) * (2.0 * math.pi / beams)
    cast_scan(np.array([pose], dtype=float), blocked, frame_of_map, range_max, bearings, ranges)
    noise = 0.0 if rng is None else rng.normal(0.0, 0.01, beams)
    ranges = np.where(ranges < range_max, ranges + noise, np.inf)
    return LaserScan(ranges, 0.0, bearings[1], 0.12, range_max, stamp, frame)
