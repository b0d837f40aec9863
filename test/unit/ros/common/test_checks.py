"""What comes from outside is refused at the door, in one line that has the value."""

import math

import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import LaserScan

from mbf_relay.ros.common import checks
from mbf_relay.ros.common.bags import sound_transforms
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.conversions import take_transform


def transform(parent="odom", child="base_link", place=(1.0, 2.0, 0.0), turn=(0.0, 0.0, 0.0, 1.0)):
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    moved, turned = message.transform.translation, message.transform.rotation
    (moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w) = place, turn
    return message


@pytest.mark.parametrize("message, words", [
    (transform(parent=""), "'' names no frame"), (transform(child="/"), "'/' names no frame"),
    *((transform(place=place), "is not within") for place in (
        (2e7, 0.0, 0.0), (0.0, -2e7, 0.0), (0.0, 0.0, 2e7), (math.nan, 0.0, 0.0), (0.0, -math.inf, 0.0))),
    *((transform(turn=turn), "has length") for turn in (
        (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.98), (0.0, 0.0, 0.2, 1.0), (0.0, 0.0, 0.0, math.nan),
        (-1e200, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, -math.inf))),
])
def test_a_robot_is_not_where_a_transform_that_means_nothing_puts_it(message, words):
    with pytest.raises(InvalidMessage, match=words):
        take_transform(message)


@pytest.mark.parametrize("message", [
    transform(place=(-9e6, 9e6, 0.0)), transform(turn=(0.0, 0.0, -1.0, 0.0)), transform(turn=(0.0, 0.0, 0.6, -0.8)),
    transform(turn=(0.0, 0.0, 0.0, 1.004)),
])
def test_a_transform_from_far_off_or_rounded_is_taken(message):
    take_transform(message)


def test_what_is_seen_is_not_stretched_by_a_rounded_rotation_of_a_recorded_bag_either():
    (taken,) = sound_transforms([transform(turn=(0.0, 0.0, 0.0, 1.004))])
    assert taken.transform.rotation.w == 1.0


@pytest.mark.parametrize("stamp, max_age, words", [
    (-0.1, None, "no time"), (math.nan, None, "no time"), (2.0 ** 31, None, "no time"),
    (1003.0, None, "3.00 s ahead"), (990.0, 5.0, "10.00 s old"), (1002.0, 5.0, ""), (990.0, None, ""), (996.0, 5.0, ""),
    (0.0, 5.0, ""),  # now
])
def test_a_robot_is_driven_by_what_is_of_this_time(stamp, max_age, words):
    if words:
        with pytest.raises(InvalidMessage, match=words):
            checks.check_stamp(stamp, 1000.0, max_age)
    else:
        checks.check_stamp(stamp, 1000.0, max_age)


@pytest.mark.parametrize("beams, first, step, words", [
    (0, 0.0, 0.01, "scan of 0 beams"), (checks.MOST_BEAMS + 1, 0.0, 1e-5, "scan of 100001 beams"),
    (360, -100.0, 0.01, "from angle -100"), (2000, 0.0, 0.01, "from angle 0"), (2000, 0.0, -0.01, "from angle 0"),
    (360, math.nan, 0.01, "from angle nan"), (360, 0.0, math.nan, "by nan rad"),
])
def test_a_scan_that_no_lidar_makes_is_not_driven_by(beams, first, step, words):
    message = LaserScan(
        angle_min=first, angle_max=first + step * beams, angle_increment=step, range_max=5.0, ranges=[3.0] * beams)
    with pytest.raises(InvalidMessage, match=words):
        checks.check_scan(message)


@pytest.mark.parametrize("width, height, is_taken", [
    (32767, 8192, True), (8192, 32767, True), (32768, 1, False), (1, 32768, False), (32767, 8193, False),
])
def test_a_map_too_long_or_too_large_for_planners_is_refused(width, height, is_taken):
    info = MapMetaData(width=width, height=height, resolution=0.05)
    if is_taken:
        checks.check_map(info, width * height)
    else:
        with pytest.raises(InvalidMessage, match=f"map of {width} x {height} cells"):
            checks.check_map(info, width * height)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_refused_by_its_name(value):
    checks.check_finite(x=0.0, y=-1e300)
    with pytest.raises(InvalidMessage, match="y is .*; it must be finite"):
        checks.check_finite(x=0.0, y=value)
