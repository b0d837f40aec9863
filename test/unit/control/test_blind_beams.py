"""Where something may hide of which a lidar measured nothing."""

import math

import numpy as np
import pytest

from mbf_relay.control.blind_beams import blind_points
from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

LONG, WIDE = 0.4, 0.25
OUTLINE = np.array([[LONG, WIDE], [-LONG, WIDE], [-LONG, -WIDE], [LONG, -WIDE]])
FAR, NOTHING = 3.0, 0.0


def scan(ranges, field=2.0 * math.pi, sign=1.0):
    """Return a scan over a field of view (rad), the beams of which go left, or right with sign -1."""
    return LaserScan(np.array(ranges, float), sign * -0.5 * field, sign * field / len(ranges), 0.12, 3.5, 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["counterclockwise", "clockwise"])
def test_what_hides_before_a_lidar_that_sits_anywhere_on_the_robot_touches_its_outline(sign):
    """It was looked for inside the robot, or metres beside it."""
    lidar = Pose2D(0.3, -0.1, 0.7)
    seen = scan([NOTHING] * 100, sign=sign)
    points = blind_points(seen, lidar, 0.2, OUTLINE)
    directions = points - np.array(lidar[:2])
    assert len(points) == 100
    assert np.maximum(np.abs(points[:, 0]) / LONG, np.abs(points[:, 1]) / WIDE) == pytest.approx(np.ones(100))
    off = np.arctan2(directions[:, 1], directions[:, 0]) - (seen.angles + lidar.theta)
    assert np.sin(off) == pytest.approx(np.zeros(100), abs=1e-9) and (np.cos(off) > 0.0).all()


def test_what_hides_before_a_lidar_outside_the_outline_is_beyond_the_robot_or_at_the_lidar():
    lidar = Pose2D(-0.6, 0.1, 0.0)
    points = blind_points(scan([NOTHING] * 4), lidar, 0.2, OUTLINE)  # backwards, right, ahead, left
    assert points == pytest.approx(np.array([[-0.6, 0.1], [-0.6, 0.1], [LONG, 0.1], [-0.6, 0.1]]))


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["counterclockwise", "clockwise"])
@pytest.mark.parametrize("field, blind, counted", [
    (6.3, range(20, 23), 3), (6.3, range(20, 22), 0), (6.3, [0, 1, 62], 3), (6.3, [0, 62], 0), (6.3, [0, 1, 2, 62], 4),
    (6.2, [0, 1, 61], 3), (6.3, [*range(5), *range(30, 32)], 5), (6.3, [61, 62, 0, 30, 31, 32], 6), (6.3, [], 0),
    (4.2, [0, 1, 40, 41], 0), (4.2, [0, 1, 2, 40, 41], 3), (4.2, [39, 40, 41], 3)])
def test_neighbouring_beams_count_from_an_angle_on_also_where_a_scan_that_goes_round_ends(field, blind, counted, sign):
    """A robot whose two ends of a scan see its own sides did not turn: they were taken for neighbours."""
    ranges = np.full(round(10.0 * field), FAR)
    ranges[list(blind)] = NOTHING
    points = blind_points(scan(ranges, field, sign), Pose2D(0.0, 0.0, 0.0), 0.25, OUTLINE)
    assert len(points) == counted
    assert not len(blind_points(scan(ranges, field, sign), Pose2D(0.0, 0.0, 0.0), 0.0, OUTLINE))


def test_one_beam_that_says_too_near_to_measure_is_believed():
    ranges = np.full(63, FAR)
    ranges[7] = -math.inf
    for width in (0.0, 0.25):
        assert len(blind_points(scan(ranges), Pose2D(0.0, 0.0, 0.0), width, OUTLINE)) == 1
