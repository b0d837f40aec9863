"""A robot whose lidar and odometry are dated by different times: it is told, and nobody else is."""

import math

import numpy as np
import pytest

from mbf_relay.localization.scan_timing import ScanTiming
from mbf_relay.outcomes import TransformError
from mbf_relay.scan import LaserScan

PERIOD = 0.2
WALLS = np.array([-2.0, 3.0, -1.5, 2.5])
"""Of a room: left and right, and lower and upper end (m)."""


def heading(t):
    """Return the heading (rad) of a robot that turns to and fro, and stands in between."""
    return 0.9 * math.sin(1.1 * t) + 0.4 * math.sin(2.7 * t)


def room(theta, beams=360, first=0.0, span=2.0 * math.pi):
    """Return what a lidar in the room reads (m) that looks by `theta` aside."""
    angles = first + span / beams * np.arange(beams) + theta
    with np.errstate(divide="ignore"):
        x = np.where(np.cos(angles) > 0.0, WALLS[1], WALLS[0]) / np.cos(angles)
        y = np.where(np.sin(angles) > 0.0, WALLS[3], WALLS[2]) / np.sin(angles)
    return np.minimum(x, y)


def round_hall(theta, beams, first, span):
    return np.full(beams, 2.0)


def timing_of(late, seconds=30.0, seen=room, odometry=heading, period=PERIOD, **layout):
    """Return what half a minute of a lidar tells whose scans are dated so late (s); readings are a centimetre off."""
    rng, timing = np.random.default_rng(1), ScanTiming()
    layout = {"beams": 360, "first": 0.0, "span": 2.0 * math.pi, **layout}
    for stamp in np.arange(2.0, 2.0 + seconds, period):
        ranges = seen(heading(stamp - late), **layout) + rng.normal(0.0, 0.01, layout["beams"])
        ranges[rng.random(len(ranges)) < 0.03] = 0.0
        timing.take(LaserScan(ranges, layout["first"], layout["span"] / layout["beams"], 0.1, 3.2, stamp), odometry)
    return timing


@pytest.mark.parametrize("late", [-0.4, -0.2, 0.15, 0.3, 0.5])
def test_a_lidar_dated_otherwise_than_odometry_is_found_out_and_by_how_much(late):
    assert timing_of(late).late == pytest.approx(late, abs=0.051)


@pytest.mark.parametrize("layout", [
    {}, {"beams": 720, "first": -math.pi}, {"beams": 541, "first": -0.75 * math.pi, "span": 1.5 * math.pi},
    {"beams": 450, "first": math.pi, "span": -2.0 * math.pi},
])
@pytest.mark.parametrize("late", [0.0, 0.25])
def test_it_makes_no_difference_which_way_a_lidar_looks_and_turns(layout, late):
    assert timing_of(late, **layout).late == pytest.approx(late, abs=0.051)


def test_a_lidar_of_many_scans_a_second_is_found_out_too():
    assert timing_of(0.3, period=0.025).late == pytest.approx(0.3, abs=0.051)


def test_nobody_is_told_of_a_lidar_and_odometry_that_agree():
    assert timing_of(0.0).late == 0.0


def test_a_robot_that_only_drives_straight_ahead_is_told_nothing():
    timing = ScanTiming()
    for stamp in np.arange(2.0, 60.0, PERIOD):
        timing.take(LaserScan(room(0.0), 0.0, math.radians(1.0), 0.1, 3.2, stamp), lambda t: 0.0)
    assert timing.late is None


def test_a_robot_in_a_room_that_looks_alike_all_round_is_told_nothing():
    assert timing_of(0.3, seen=round_hall).late is None


def test_a_robot_whose_wheels_slip_is_not_told_of_its_clocks():
    """It turns half as far as odometry has it: at no time do the two agree."""
    assert timing_of(0.0, odometry=lambda t: 2.0 * heading(t)).late is None


def test_a_robot_whose_odometry_is_not_known_at_a_time_is_told_by_what_is_known():
    def now_and_then(t):
        if t % 10.0 < 5.0:
            raise TransformError("no transform from 'base' to 'odom'")
        return heading(t)

    assert timing_of(0.3, odometry=now_and_then, seconds=45.0).late == pytest.approx(0.3, abs=0.051)


def test_a_clock_that_is_set_back_begins_anew():
    timing = timing_of(0.3)
    for stamp in np.arange(1.0, 31.0, PERIOD):
        timing.take(LaserScan(room(heading(stamp)), 0.0, math.radians(1.0), 0.1, 3.2, stamp), heading)
    assert timing.late == 0.0
