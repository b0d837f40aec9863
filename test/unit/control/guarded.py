"""A guard of a burger, and scans for it."""

import math

import numpy as np

from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.scan import LaserScan

BURGER = [[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]]
TEE = [[-0.3, -0.1], [-0.3, 0.1], [0.1, 0.1], [0.1, 0.3], [0.2, 0.3], [0.2, -0.3], [0.1, -0.3], [0.1, -0.1]]
LASER = Pose2D(-0.032, 0.0, 0.0)
BEAMS = 360
AHEAD = Twist2D(0.22, 0.0, 0.0)


def parameters(**values):
    return VelocityGuardParameters(**{"footprint": BURGER, "base_frame": "base_footprint", **values})


def scan_of(ranges, stamp=0.0, angle_min=0.0, increment=2.0 * math.pi / BEAMS):
    return LaserScan(np.array(ranges, dtype=float), angle_min, increment, 0.12, 3.5, stamp)


def scan_with(distance, start, end, stamp=0.0):
    """Return a scan that reads `distance` (m) between two directions (degrees) and nothing elsewhere."""
    ranges = np.full(BEAMS, np.inf)
    ranges[np.arange(start, end) % BEAMS] = distance
    return scan_of(ranges, stamp)


def guard_that_saw(scan, outline=BURGER, **values):
    guard = VelocityGuard(parameters(footprint=outline, **values))
    guard.take_scan(scan, LASER)
    return guard


def judged(guard, velocity, now=0.0):
    guard.take_command(now, velocity)
    return guard.verdict(now)
