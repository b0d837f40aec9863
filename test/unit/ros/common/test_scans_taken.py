"""What of a lidar's message is believed: a scan that has fewer beams than it says leaves a robot blind on one side."""

import math

import pytest
from sensor_msgs.msg import LaserScan

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.conversions import scan_from_message

DEGREE = math.pi / 180.0


def scan(first, last, increment, beams):
    return LaserScan(
        angle_min=first, angle_max=last, angle_increment=increment, range_max=5.0, ranges=[3.0] * beams)


@pytest.mark.parametrize("message, words", [
    (scan(-math.pi, math.pi, DEGREE, 120), "120 beams"),  # the last 240, ahead and left, got lost
    (scan(-math.pi, math.pi, 0.0, 360), "360 beams"),  # all of them look behind
    (scan(0.0, 0.0, 0.0, 360), "360 beams"),
    (scan(1e30, 1e30, DEGREE, 360), "from angle 1e\\+30"),  # where one number stands for every beam's angle
    (scan(math.pi, -math.pi, DEGREE, 360), "against"),  # or what is left stands on the right
])
def test_a_scan_that_contradicts_itself_about_where_it_looks_is_not_driven_by(message, words):
    with pytest.raises(InvalidMessage, match=words):
        scan_from_message(message)


@pytest.mark.parametrize("message", [
    scan(0.0, 2.0 * math.pi, DEGREE, 360),  # a beam fewer than it says, as LDS-01's driver has it
    scan(-math.pi, math.pi, DEGREE, 350),  # a motor that runs a little fast
    scan(math.pi, -math.pi, -DEGREE, 361),  # upside down
    scan(-math.pi, 0.0, DEGREE, 360),  # a driver that leaves angle_max alone
    scan(math.pi / 2.0, 0.0, DEGREE, 360),
    scan(0.0, 0.0, 0.0, 1),  # one that looks into one direction
])
def test_the_drivers_there_are_are_believed(message):
    assert len(scan_from_message(message).ranges) == len(message.ranges)


@pytest.mark.parametrize("range_max", [3.5, 3500.0, math.inf])
def test_a_lidar_that_counts_in_millimetres_from_zero_on_is_not_driven_by(range_max):
    """Its walls stood a kilometre off, or beyond range_max, and counted as free."""
    message = scan(-math.pi, math.pi, DEGREE, 360)
    message.range_max, message.ranges = range_max, [0.0] * 20 + [math.inf] * 20 + [180.0 + beam for beam in range(320)]
    with pytest.raises(InvalidMessage, match=r"nearest reading is 180 m.* are its ranges in metres\?"):
        scan_from_message(message)


@pytest.mark.parametrize("ranges", [
    [65.533] * 360, [30001.0] * 360, [math.inf] * 359 + [math.nan],  # what drivers say where nothing came back
    [120.0 + 0.1 * beam for beam in range(359)] + [4.0],  # a wide field with one post in it
])
def test_a_lidar_in_an_open_place_is_believed(ranges):
    message = scan(-math.pi, math.pi, DEGREE, 360)
    message.range_max, message.ranges = 250.0, ranges
    assert len(scan_from_message(message).ranges) == 360


def test_a_scan_whose_frame_is_named_by_a_book_is_refused_in_a_line():
    message = scan(-math.pi, math.pi, DEGREE, 360)
    message.header.frame_id = "a" * 100000
    with pytest.raises(InvalidMessage, match=r"\(100000 characters\)' names no frame") as refusal:
        scan_from_message(message)
    assert len(str(refusal.value)) < 100


@pytest.mark.parametrize("beams, increment, scan_time, told", [
    (360, 1.92e-4, 0.0, 0.0),  # the XV-11's, of 5 turns a second: it looked like one of which every third scan comes
    (360, 0.1 / 359, 0.1, 0.1),  # RPLidars'
    (270, 0.1 / 360, 0.1, 0.075),  # Hokuyos', which give the time of a whole turn
    (270, 0.1 / 270, 0.1, 0.1),
    (270, -0.1 / 360, 0.1, 0.075),
    (360, 0.1 / 360, 0.2, 0.0), (360, math.nan, 0.1, 0.0), (360, math.inf, 0.1, 0.0), (360, 0.1 / 360, math.nan, 0.0),
    (360, 0.0, 0.0, 0.0),
])
def test_how_long_a_scan_takes_is_believed_of_a_driver_that_says_it_twice(beams, increment, scan_time, told):
    """Walls stayed bent in turns with a lidar whose driver gives the motor's speed as the time between two beams."""
    message = scan(0.0, math.radians(beams), DEGREE, beams)
    message.time_increment, message.scan_time = increment, scan_time
    assert scan_from_message(message).sweep_time == pytest.approx(told, rel=0.01)
