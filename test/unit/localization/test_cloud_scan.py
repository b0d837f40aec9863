import math

import numpy as np
import pytest
from synthetic_room import room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.cloud_scan import CloudParameters, scan_of_points
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters

TRUTH = Pose2D(1.5, 0.5, 0.3)
SENSOR = np.array([0.2, -0.1, 0.4])


def wall_of(scan, heights):
    """Return what a lidar of many rings at SENSOR sees where a planar one sees `scan`: points in the base's frame."""
    seen = np.isfinite(scan.ranges)
    ranges, angles = scan.ranges[seen], scan.angles[seen]
    ring = np.column_stack((SENSOR[0] + ranges * np.cos(angles), SENSOR[1] + ranges * np.sin(angles)))
    return np.vstack([np.column_stack((ring, np.full(len(ring), height))) for height in heights])


def seen(points, **values):
    return scan_of_points(np.array(points, dtype=float), SENSOR, CloudParameters(**values), 7.0, "camera")


def test_a_robot_with_a_lidar_of_many_rings_knows_where_it_is():
    """Floor, a table top overhead and the robot itself are in the cloud, and none of them on the map."""
    laser = Pose2D(float(SENSOR[0]), float(SENSOR[1]), 0.0)
    cloud = wall_of(scan_at(room(), TRUTH.compose(laser), np.random.default_rng(1)), (0.2, 0.5, 0.8))
    floor = np.column_stack((np.random.default_rng(2).uniform(-3.0, 3.0, (2000, 2)), np.zeros(2000)))
    own = np.column_stack((SENSOR[:2] + np.random.default_rng(3).uniform(-0.1, 0.1, (50, 2)), np.full(50, 0.3)))
    values = CloudParameters(range_min=0.15)
    scan = scan_of_points(np.vstack((cloud, floor, floor + (0.0, 0.0, 1.4), own)), SENSOR, values, 0.0, "camera")
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(Pose2D(1.4, 0.6, 0.35), np.diag([0.1, 0.1, 0.05]) ** 2)
    estimate = made.process(IDENTITY, scan, laser)
    assert estimate.pose.distance_to(TRUTH) < 0.05
    assert made.reliability() > 0.8


def test_of_each_direction_the_nearest_point_of_the_height_counts():
    scan = seen(
        [(2.2, -0.1, 0.5), (1.2, -0.1, 0.5), (0.7, -0.1, 1.5), (0.7, -0.1, 0.0), (0.2, 2.9, 0.3)],
        angle_increment=math.pi / 2.0, angle_min=-math.pi / 4.0, angle_max=3.0 * math.pi / 4.0,
    )
    assert scan.ranges == pytest.approx([1.0, 3.0])
    assert scan.angles == pytest.approx([0.0, math.pi / 2.0])
    assert (scan.frame, scan.stamp) == ("camera", 7.0)


def test_a_direction_without_a_point_has_no_reading():
    """A camera that looks ahead says nothing of what is behind the robot: it must not count as free."""
    scan = seen([(2.2, -0.1, 0.5)])
    assert np.count_nonzero(np.isfinite(scan.ranges)) == 1
    assert np.isnan(scan.ranges).sum() == len(scan.ranges) - 1


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((5, 3), np.nan), np.full((5, 3), np.inf)])
def test_a_cloud_of_nothing_leaves_the_filter_sane(points):
    with np.errstate(invalid="ignore"):
        scan = scan_of_points(points, SENSOR, CloudParameters(), 0.0, "camera")
    assert np.isnan(scan.ranges).all()
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(TRUTH, np.diag([0.1, 0.1, 0.05]) ** 2)
    assert made.process(IDENTITY, scan, IDENTITY).pose.distance_to(TRUTH) < 0.1


def test_points_on_the_last_border_belong_to_the_last_direction():
    scan = seen([(-1.0, -0.1, 0.5), (-1.0, -0.1000001, 0.5)], angle_increment=0.7)
    assert len(scan.ranges) == 9
    assert np.isfinite(scan.ranges[[0, -1]]).all()


@pytest.mark.parametrize(
    "values", [{"min_height": 2.0}, {"angle_min": 1.0, "angle_max": 1.0}, {"range_min": 5.0, "range_max": 4.0}]
)
def test_limits_that_leave_nothing_are_refused(values):
    with pytest.raises(ValueError, match="must be below"):
        CloudParameters(**values)
