"""A robot whose lidar sees nothing nearer than its range_min goes on beside what it has seen before."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.near_things import MANY, NearThings
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import ScanMonitor

LEAST = 0.45
"""Metres below which a Kinect measures nothing."""
WALL = 1.5
"""Metres at which a wall stands across the x axis; another one stands across the y axis as far away."""


BEAMS, WIDTH = 640, math.radians(57.0)


def depth_camera(x, theta=0.0, nothing=math.nan, dead=()):
    """Return what a camera at (x, 0) that looks along theta sees, in the angles of its own frame."""
    angles = -0.5 * WIDTH + WIDTH / BEAMS * np.arange(BEAMS)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(*((side / ray if side > 0.0 else 9.0) for side, ray in (
            (WALL - x, np.maximum(np.cos(angles + theta), 1e-9)), (WALL, np.maximum(np.sin(angles + theta), 1e-9)))))
    ranges[(ranges < LEAST)] = nothing
    for first, behind in dead:
        ranges[first:behind] = nothing
    return LaserScan(ranges, -0.5 * WIDTH, WIDTH / BEAMS, LEAST, 4.0, 1.0)


def drive(monitor, to, step=0.02):
    """Return what the monitor says on the way to the wall."""
    return [monitor.trouble(depth_camera(x), 0.0, Pose2D(x, 0.0, 0.0)) for x in np.arange(0.0, to, step)]


def test_a_robot_that_has_come_near_a_wall_goes_on_though_it_sees_that_no_more():
    """It stood for good: its camera measures nothing where the wall is, and nothing that it may do leads away."""
    told = drive(ScanMonitor(), WALL - 0.37)
    assert np.isnan(depth_camera(WALL - 0.38).ranges).sum() > 400
    assert told == [None] * len(told)


def test_a_robot_that_turns_beside_a_wall_it_has_seen_goes_on():
    monitor = ScanMonitor()
    drive(monitor, WALL - 0.4)
    for theta in np.arange(0.0, 0.4, 0.05):
        assert monitor.trouble(depth_camera(WALL - 0.4, theta), 0.0, Pose2D(WALL - 0.4, 0.0, theta)) is None


@pytest.mark.parametrize("x", [0.0, 0.5, WALL - 0.6])
def test_a_robot_whose_lidar_fails_where_nothing_near_was_seen_does_not_drive(x):
    monitor = ScanMonitor()
    drive(monitor, x)
    blind = depth_camera(x, dead=[(100, 400)])
    assert "ahead" in monitor.trouble(blind, 0.0, Pose2D(x - 0.2, 0.0, 0.0))


def test_a_robot_between_two_near_walls_whose_lidar_fails_ahead_does_not_drive():
    """What hides to the sides explains nothing that lies between."""
    monitor, angles = ScanMonitor(), math.radians(1.0) * np.arange(-90, 90)
    for width in (0.6, 0.3):
        ranges = np.minimum(width / np.maximum(np.abs(np.sin(angles)), 1e-9), 3.0)
        if width < 0.6:
            ranges[ranges < LEAST] = 0.0
            ranges[np.abs(angles) < math.radians(45.0)] = 0.0
        told = monitor.trouble(LaserScan(ranges, angles[0], math.radians(1.0), LEAST, 4.0, 1.0), 0.0, Pose2D(0, 0, 0))
    assert "measures nothing in" in told


def test_what_was_seen_near_is_forgotten_where_a_beam_looks_past_it():
    things = NearThings()
    there = depth_camera(WALL - 0.5)
    things.hides(there, Pose2D(WALL - 0.5, 0.0, 0.0))
    away = depth_camera(0.0)
    away.ranges[:10] = math.nan
    assert not things.hides(away, Pose2D(WALL - 0.5, 0.0, 0.0)).any()  # the wall is gone
    blind = depth_camera(WALL - 0.4)
    assert not things.hides(blind, Pose2D(WALL - 0.4, 0.0, 0.0))[100:500].any()


def test_which_beams_look_at_what_was_seen_is_told_over_the_ends_of_a_scan_as_well():
    """The lidar looks all round, the other way round as well, and begins in any direction."""
    for begin in (-math.pi, 0.0, 1.3):
        for step in (math.radians(1.0), -math.radians(1.0)):
            things, angles = NearThings(), begin + step * np.arange(360)
            bearings = np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi
            at_left = np.abs(np.abs(bearings) - math.pi) < math.radians(30.0)
            things.hides(LaserScan(np.where(at_left, 0.5, 3.0), begin, step, LEAST, 4.0, 1.0), Pose2D(0.0, 0.0, 0.0))
            near = LaserScan(np.where(at_left, 0.0, 3.0), begin, step, LEAST, 4.0, 1.0)
            hidden = things.hides(near, Pose2D(-0.1, 0.0, 0.0))
            assert (hidden == at_left).all(), (begin, step)


def test_it_holds_no_more_than_so_many_points_however_long_a_robot_stands_before_a_wall():
    things, rng = NearThings(), np.random.default_rng(1)
    for step in range(300):
        seen = depth_camera(WALL - 0.5)
        seen.ranges[:] += rng.normal(0.0, 0.03, len(seen.ranges))
        things.hides(seen, Pose2D(WALL - 0.5, 0.001 * step, 0.0))
        assert len(things._points) <= MANY + len(seen.ranges)


@pytest.mark.parametrize("increment", [1e-12, 1e-3, -1e-12, 0.05])
def test_beams_as_near_to_each_other_as_can_be_take_no_more_memory(increment):
    things = NearThings()
    for ranges in (np.full(100, 0.5), np.where(np.arange(100) % 2, 0.5, 0.0)):
        hidden = things.hides(LaserScan(ranges, 0.0, increment, LEAST, 4.0, 1.0), Pose2D(0.0, 0.0, 0.0))
    assert (hidden == (np.arange(100) % 2 == 0)).all()
