"""A lidar that is tilted sees walls as far away as they are along the floor."""

import math
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan

from mbf_relay.ros.common.lidar_geometry import scan_in_base


def seen_by_lidar_tilted(degrees, upside_down=False):
    """Return what a lidar, tilted forwards, sees that reads 1 m ahead and to the left, and nothing behind."""
    half = 0.5 * math.radians(degrees)
    turned = Quaternion(0.0, math.sin(half), 0.0, math.cos(half))
    if upside_down:  # about its x axis, before it is tilted
        turned = Quaternion(math.cos(half), 0.0, -math.sin(half), 0.0)
    placed = TransformStamped(transform=Transform(Vector3(0.0, 0.0, 0.5), turned))
    message = LaserScan(
        angle_max=math.pi, angle_increment=math.pi / 2.0, range_min=0.1, range_max=5.0, ranges=[1.0, 1.0, math.inf])
    message.header.frame_id = "laser"
    return scan_in_base(message, "base", SimpleNamespace(lookup_message=lambda *_, **__: placed)).scan


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 1.0, 10.0, 30.0, -45.0])
def test_walls_are_as_near_as_along_the_floor(degrees, upside_down):
    """At 30 degrees the guard and amcl took what was 0.87 m ahead for 1 m, and the robot braked too late."""
    scan = seen_by_lidar_tilted(degrees, upside_down)
    side = -1.0 if upside_down else 1.0
    ahead, beside = scan.hit_points
    assert ahead == pytest.approx([math.cos(math.radians(degrees)), 0.0], abs=1e-3)
    assert beside == pytest.approx([0.0, side], abs=1e-3)
    assert scan.ranges[2] == math.inf and scan.measured.all()
