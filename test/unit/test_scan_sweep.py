"""A robot that drives and turns while its lidar looks round: walls are where they are, not where they were seen."""

import math

import numpy as np
import pytest
from four_walls import seen_from

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.scan import LaserScan
from mbf_relay.scan_sweep import FORWARDS, ORDERS, seen_at_once

MOVED = Pose2D(0.06, 0.01, 0.4)
"""Of the lidar while it looks round once: 0.3 m/s and 2 rad/s for a fifth of a second."""


def swept(first, increment, beams, moved=MOVED, way=1, start=0):
    """Return a scan whose lidar moved by `moved` meanwhile, was at the origin halfway, and began with beam `start`."""
    share = way * ((np.arange(beams) - start) % beams + 0.5 - 0.5 * beams) / beams
    along, turn = Pose2D(0.0, 0.0, -0.5 * moved.theta).compose(Pose2D(moved.x, moved.y, 0.0)), share * moved.theta
    angles = first + increment * np.arange(beams)
    ranges = seen_from(share * along.x, share * along.y, angles + turn)
    return LaserScan(ranges, first, increment, 0.1, 4.0, 7.0, "laser")


LAYOUTS = [
    (0.0, math.radians(1.0), 360), (math.pi, -math.radians(1.0), 360), (-math.pi, 2.0 * math.pi / 720, 720),
    (-0.75 * math.pi, math.radians(0.25), 1081), (0.3, 2.0 * math.pi / 90, 90),
]


@pytest.mark.parametrize("first, increment, beams", LAYOUTS)
def test_walls_are_read_as_from_where_the_lidar_was_halfway(first, increment, beams):
    scan = swept(first, increment, beams)
    set_right = seen_at_once(scan, FORWARDS, MOVED)
    truth = seen_from(0.0, 0.0, scan.angles)
    measured = ~np.isnan(set_right.ranges)
    assert measured.mean() > 0.9
    errors = np.abs(set_right.ranges - truth)[measured]
    assert np.percentile(errors, 95) <= 3.0 * abs(increment) and errors.max() < 0.2  # each up to half a beam aside
    assert np.abs(scan.ranges - truth).max() > 0.3  # as it came


@pytest.mark.parametrize("order, way, start", list(zip(ORDERS, (0, 1, -1, 1, -1), (0, 0, 0, 180, 180))))
def test_walls_are_read_so_in_whichever_order_beams_are_taken(order, way, start):
    scan = swept(*LAYOUTS[0], way=way, start=start)
    errors = np.abs(seen_at_once(scan, order, MOVED).ranges - seen_from(0.0, 0.0, scan.angles))
    assert np.nanpercentile(errors, 95) <= 0.05 and np.nanmax(errors) < 0.2


def test_what_the_lidar_turned_away_from_is_not_made_up():
    """It turned with the sensor: between its last beam and its first lies what neither looked at halfway."""
    set_right = seen_at_once(swept(*LAYOUTS[0]), FORWARDS, Pose2D(MOVED.x, MOVED.y, -MOVED.theta))
    unseen = np.degrees(set_right.angles[np.isnan(set_right.ranges)])
    assert 15 <= len(unseen) <= 25 and (np.minimum(unseen, 360.0 - unseen) < 15.0).all()


@pytest.mark.parametrize("reading", [math.inf, 0.0, math.nan])
def test_directions_in_which_nothing_came_back_stay_so_and_turn_with_the_robot(reading):
    scan = swept(*LAYOUTS[0])
    scan.ranges[240:270] = reading  # taken when the robot had turned by a sixth to a quarter beyond halfway of 0.4 rad
    ranges = seen_at_once(scan, FORWARDS, MOVED).ranges
    kept = np.isnan(ranges) if math.isnan(reading) else ranges == reading
    assert kept[247:271].all() and not kept[200:240].any()


def test_a_lidar_that_stood_still_reads_what_it_read():
    scan = swept(*LAYOUTS[0], moved=IDENTITY)
    set_right = seen_at_once(scan, FORWARDS, IDENTITY)
    assert np.allclose(set_right.ranges, scan.ranges) and (set_right.stamp, set_right.frame) == (7.0, "laser")


def test_a_lidar_that_shows_nothing_and_one_of_a_single_beam_are_returned_as_they_are():
    blind = LaserScan(np.full(360, np.nan), 0.0, math.radians(1.0), 0.1, 4.0, 7.0)
    assert np.isnan(seen_at_once(blind, FORWARDS, MOVED).ranges).all()
    single = LaserScan(np.array([1.0]), 0.0, math.radians(1.0), 0.1, 4.0, 7.0)
    assert seen_at_once(single, FORWARDS, MOVED).ranges == pytest.approx([1.0])
