"""A robot whose lidar is dated by another time than odometry, or looks round while it turns: that is found out."""

import math

import numpy as np
import pytest
from four_walls import seen_from

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.scan import LaserScan
from mbf_relay.scan_sweep import AT_ONCE, BACKWARDS, FORWARDS, ORDERS
from mbf_relay.scan_timing import ScanTiming

PERIOD = 0.2


def turning(odometry):
    """Return the pose at a time (s) of a robot that turns as odometry has it, on the spot."""
    return lambda t: Pose2D(0.0, 0.0, odometry(t))


def heading(t):
    """Return the heading (rad) of a robot that turns to and fro, and stands in between; of one time (s) or many."""
    return 0.9 * np.sin(1.1 * t) + 0.4 * np.sin(2.7 * t)


def room(theta, beams=360, first=0.0, span=2.0 * math.pi):
    """Return what a lidar in the room reads (m) that looks by `theta` aside."""
    return seen_from(0.0, 0.0, first + span / beams * np.arange(beams) + theta)


def round_hall(theta, beams, first, span):
    return np.full(beams, 2.0)


def sweep(t, period, order, beams=360, first=0.0, span=2.0 * math.pi):
    """Return what a lidar reads (m) halfway through whose scan it is t (s); order is a way and a start, as Order's."""
    way, start = order
    times = t + way * (((np.arange(beams) + 0.5) / beams - start) % 1.0 - 0.5) * period * abs(span) / (2.0 * math.pi)
    return seen_from(0.0, 0.0, first + span / beams * np.arange(beams) + heading(times))


def timing_of_sweeps(order, late=0.0, seconds=12.0, period=PERIOD, out_of=1, told=0.0, **layout):
    """Return what so many seconds tell of a lidar that looks round while it turns; readings are a centimetre off.

    One of `out_of` scans comes, of which the driver says that its beams took `told` seconds.
    """
    rng, timing = np.random.default_rng(2), ScanTiming()
    layout = {"beams": 360, "first": 0.0, "span": 2.0 * math.pi, **layout}
    for stamp in np.arange(2.0, 2.0 + seconds, out_of * period):
        ranges = sweep(stamp - late, period, order, **layout) + rng.normal(0.0, 0.01, layout["beams"])
        ranges[rng.random(len(ranges)) < 0.03] = 0.0
        increment = layout["span"] / layout["beams"]
        scan = LaserScan(ranges, layout["first"], increment, 0.1, 3.2, stamp, sweep_time=told)
        timing.take(scan, turning(heading))
    return timing


@pytest.mark.parametrize("order", [FORWARDS, BACKWARDS])
@pytest.mark.parametrize("period, out_of", [(0.2, 2), (0.1, 4)])
def test_walls_stand_straight_in_a_turn_where_scans_are_throttled(order, period, out_of):
    """A lidar of which every second scan came was thought to look round half as fast: its walls stayed bent."""
    timing = timing_of_sweeps(order, seconds=40.0, period=period, out_of=out_of, told=0.98 * period)
    assert timing.order == order
    raw = LaserScan(sweep(23.1, period, order), 0.0, math.radians(1.0), 0.1, 4.0, 23.1, sweep_time=0.98 * period)
    scan = timing.corrected(raw, turning(heading))
    assert np.nanpercentile(np.abs(scan.ranges - room(heading(23.1))), 95) < 0.05


@pytest.mark.parametrize("told", [0.0, 0.005, 0.13, 0.19, 0.2, 0.4, math.inf, math.nan])
def test_a_driver_that_misstates_how_long_a_scan_takes_is_not_believed(told):
    assert timing_of_sweeps(FORWARDS, told=told).order == FORWARDS


@pytest.mark.parametrize("order", [FORWARDS, BACKWARDS, AT_ONCE])
@pytest.mark.parametrize("layout", [
    {}, {"beams": 720, "first": -math.pi}, {"beams": 541, "first": -0.75 * math.pi, "span": 1.5 * math.pi},
    {"beams": 450, "first": math.pi, "span": -2.0 * math.pi}, {"beams": 90}, {"period": 0.1},
])
def test_which_beam_of_a_lidar_comes_first_is_found_out(order, layout):
    assert timing_of_sweeps(order, **layout).order == order


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_found_out_of_one_whose_driver_sorts_beams_by_their_angles(order):
    assert timing_of_sweeps(order, first=-math.pi).order == order


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("start, told", [(0.1, 0.0), (0.4, 0.5)])
def test_one_that_begins_elsewhere_is_taken_for_the_most_alike(way, start, told):
    assert timing_of_sweeps((way, start)).order == (way, told)


@pytest.mark.parametrize("order", [FORWARDS, BACKWARDS])
def test_it_is_found_out_of_a_lidar_that_is_dated_by_another_clock_too(order):
    timing = timing_of_sweeps(order, late=0.3, seconds=60.0)
    assert (timing.order, timing.late) == (order, pytest.approx(0.3, abs=0.051))


@pytest.mark.parametrize("order", [FORWARDS, BACKWARDS])
def test_walls_stand_straight_in_a_turn_once_that_is_known(order):
    """The scan of a robot that turned showed each wall bent by up to a fifth of a radian: two walls where one is."""
    timing = timing_of_sweeps(order)
    stamp = 23.1
    raw = LaserScan(sweep(stamp, PERIOD, order), 0.0, math.radians(1.0), 0.1, 4.0, stamp)
    truth, scan = room(heading(stamp)), timing.corrected(raw, turning(heading))
    assert np.abs(raw.ranges - truth).max() > 0.2
    assert np.nanpercentile(np.abs(scan.ranges - truth), 95) < 0.05 and np.isnan(scan.ranges).mean() < 0.07


def test_a_scan_is_dated_by_odometrys_time_once_that_is_known():
    raw = LaserScan(room(0.0), 0.0, math.radians(1.0), 0.1, 3.2, 40.0)
    assert timing_of(0.3).corrected(raw, turning(heading)).stamp == pytest.approx(39.7, abs=0.051)
    assert timing_of(0.0).corrected(raw, turning(heading)) is raw
    assert ScanTiming().corrected(raw, turning(heading)) is raw


def test_a_scan_of_before_odometry_began_is_returned_as_it_came():
    def unknown(_time):
        raise TransformError("no transform from 'base' to 'odom'")

    raw = LaserScan(room(0.0), 0.0, math.radians(1.0), 0.1, 3.2, 40.0)
    assert timing_of_sweeps(FORWARDS).corrected(raw, unknown) is raw


def test_a_scan_is_not_torn_apart_where_odometry_is_set_to_another_place():
    """Its beams would lie along the metres that odometry went in a moment."""
    raw = LaserScan(room(0.0), 0.0, math.radians(1.0), 0.1, 3.2, 40.0)
    timing = timing_of_sweeps(FORWARDS)
    assert timing.corrected(raw, lambda time: Pose2D(0.0 if time < 39.95 else 3.0, 0.0, 0.0)) is raw
    assert timing.corrected(raw, lambda time: Pose2D(0.05 * time, 0.0, 0.0)) is not raw


def test_a_scan_that_another_costmap_was_given_before_teaches_nothing_twice():
    once, twice = ScanTiming(), ScanTiming()
    stamps = np.arange(2.0, 12.0, PERIOD)
    for number, stamp in enumerate(stamps):
        scan = LaserScan(sweep(stamp, PERIOD, FORWARDS), 0.0, math.radians(1.0), 0.1, 3.2, stamp)
        old = stamps[max(0, number - 5)]
        once.take(scan, turning(heading))
        for each in (scan, scan, LaserScan(sweep(old, PERIOD, FORWARDS), 0.0, math.radians(1.0), 0.1, 3.2, old)):
            twice.take(each, turning(heading))
    assert once.order == twice.order == FORWARDS and (once._votes == twice._votes).all()


def timing_of(late, seconds=30.0, seen=room, odometry=heading, period=PERIOD, **layout):
    """Return what half a minute of a lidar tells whose scans are dated so late (s); readings are a centimetre off."""
    rng, timing = np.random.default_rng(1), ScanTiming()
    layout = {"beams": 360, "first": 0.0, "span": 2.0 * math.pi, **layout}
    for stamp in np.arange(2.0, 2.0 + seconds, period):
        ranges = seen(heading(stamp - late), **layout) + rng.normal(0.0, 0.01, layout["beams"])
        ranges[rng.random(len(ranges)) < 0.03] = 0.0
        increment = layout["span"] / layout["beams"]
        timing.take(LaserScan(ranges, layout["first"], increment, 0.1, 3.2, stamp), turning(odometry))
    return timing


@pytest.mark.parametrize("late", [-0.43, -0.2, -0.1, 0.1, 0.12, 0.3, 0.5])
def test_a_lidar_dated_otherwise_than_odometry_is_found_out_and_by_how_much(late):
    assert timing_of(late).late == pytest.approx(late, abs=0.021)


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
        timing.take(LaserScan(room(0.0), 0.0, math.radians(1.0), 0.1, 3.2, stamp), turning(lambda t: 0.0))
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
        timing.take(LaserScan(room(heading(stamp)), 0.0, math.radians(1.0), 0.1, 3.2, stamp), turning(heading))
    assert timing.late == 0.0
