"""A robot that turns while its lidar looks round: its costmap has walls where they are, whichever beam came first."""

import math

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from scan_source import scan_source
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.conversions import scan_from_message
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.costmap import inputs

PERIOD, BEAMS, HALF = 0.2, 360, 0.8
"""Seconds a scan takes, its beams, and half the side (m) of the square room round the robot."""


def heading(time):
    """Return where a robot looks (rad) that turns to and fro on the spot."""
    return 0.9 * np.sin(1.1 * time) + 0.4 * np.sin(2.7 * time)


class TurningFrames:
    """Those of such a robot, whose lidar sits at its middle, upside down if asked; odometry comes `late` s late."""

    def __init__(self, upside_down=False, late=0.0):
        self.upside_down, self.late, self.now = upside_down, late, 0.0

    @staticmethod
    def rides_on(_base, _frame):
        return True

    def _yaw(self, target, when):
        if target == "base_link":
            return 0.0
        if when is not None and when > self.now - self.late:
            raise TransformError("extrapolation into the future")
        return heading(self.now - self.late if when is None else when)

    def lookup(self, target, _source, when=None):
        return Pose2D(0.0, 0.0, self._yaw(target, when))

    def lookup_message(self, target, source, when=None, max_age=None):
        message, half = TransformStamped(), 0.5 * self._yaw(target, when)
        if source == "laser" and self.upside_down:  # turned about x, then about z
            message.transform.rotation.x, message.transform.rotation.y = math.cos(half), math.sin(half)
        else:
            message.transform.rotation.z, message.transform.rotation.w = math.sin(half), math.cos(half)
        return message


class PanningFrames(TurningFrames):
    """Those of a robot that stands and pans its lidar, of which tf tells ten times a second."""

    def _yaw(self, _target, when):
        newest = math.floor(10.0 * self.now) / 10.0
        if when is not None and when > newest:
            raise TransformError("extrapolation into the future")
        return heading(newest if when is None else when)

    def lookup(self, _target, _source, _when=None):
        return IDENTITY

    def lookup_message(self, target, source, when=None, max_age=None):
        message = super().lookup_message(target, source, when)
        message.header.stamp = rospy.Time.from_sec(self.now if when is None else when)  # of no static transform
        return message


class BroadcastFrames(TurningFrames):
    """Those of a robot that turns, whose lidar a node of its own tells tf of, ten times a second."""

    def lookup_message(self, target, source, when=None, max_age=None):
        newest = math.floor(10.0 * self.now) / 10.0
        if when is not None and when > newest:
            raise TransformError("extrapolation into the future")
        return super().lookup_message(target, source, newest if when is None else when)


def scan_at(middle, order, upside_down, late):
    """Return a scan whose middle beam was taken at a time (s), dated `late` s later."""
    shares = (np.arange(BEAMS) + 0.5) / BEAMS - 0.5
    angles = 2.0 * math.pi / BEAMS * np.arange(BEAMS)
    directions = heading(middle + order * shares * PERIOD) + (-angles if upside_down else angles)
    ranges = HALF / np.maximum(np.abs(np.cos(directions)), np.abs(np.sin(directions)))
    message = LaserScan(angle_increment=2.0 * math.pi / BEAMS, range_min=0.1, range_max=3.5, ranges=list(ranges))
    message.header.frame_id, message.header.stamp = "laser", inputs.rospy.Time.from_sec(middle + late)
    return message


def bends_of(
    monkeypatch, order, upside_down=False, late=0.0, odometry_late=0.0, seconds=40.0, frames_of=TurningFrames
):
    """Return by how much (m) walls were marked aside: of each scan the worst tenth of its points."""
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: frames.now)
    frames, bends = frames_of(upside_down, odometry_late), []
    costmap, sensor = scan_source(frames, patience=0.5)

    def observe(_name, observation, _now):
        aside = np.abs(np.abs(observation.points[:, :2]).max(axis=1) - HALF)
        bends.append(np.percentile(aside, 90))

    monkeypatch.setattr(costmap, "observe", observe)
    for middle in np.arange(2.0, 2.0 + seconds, PERIOD):
        frames.now = middle + 0.5 * PERIOD + max(0.0, late)
        sensor._keep(scan_at(middle, order, upside_down, late))
        for _ in range(4):
            frames.now += 0.04
            sensor.feed(frames.now)
            costmap.update(frames.now, IDENTITY)
    return bends


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("upside_down", [False, True])
def test_walls_are_marked_where_they_are_whichever_beam_comes_first(monkeypatch, order, upside_down):
    bends = bends_of(monkeypatch, order, upside_down)
    assert max(bends[:10]) > 0.05  # not known yet
    assert max(bends[-50:]) < 0.025


def test_walls_are_marked_where_they_are_though_odometry_comes_after_the_scans(monkeypatch):
    assert max(bends_of(monkeypatch, 1, odometry_late=0.2)[-50:]) < 0.025


def test_walls_are_marked_where_they_are_though_the_lidar_has_another_clock(monkeypatch):
    bends = bends_of(monkeypatch, -1, late=0.3, seconds=60.0)
    assert max(bends[:50]) > 0.2
    assert max(bends[-50:]) < 0.08  # the offset is told to a twentieth of a second


def test_a_lidar_that_takes_all_beams_at_once_is_believed_as_it_is(monkeypatch):
    assert max(bends_of(monkeypatch, 0)) < 1e-6


@pytest.mark.parametrize("order", [1, 0, -1])
def test_a_lidar_that_pans_on_the_robot_is_not_taken_for_one_with_another_clock(monkeypatch, order):
    """Its walls were marked up to a quarter of a metre aside as soon as enough scans had told when they were taken."""
    assert max(bends_of(monkeypatch, order, frames_of=PanningFrames)[-50:]) < 0.025


@pytest.mark.parametrize("order", [1, -1])
def test_walls_are_straight_to_amcl_though_tf_tells_of_the_lidar_later_than_of_the_robot(order):
    """It takes a scan once odometry is known; each was left bent for which tf had not told of the lidar by then."""
    frames, bends = BroadcastFrames(), []
    timings = LidarTimings(frames, lambda: ("base_link", "odom"))
    for middle in np.arange(2.03, 42.0, PERIOD):
        frames.now = middle + 0.05
        scan = timings.corrected(scan_from_message(scan_at(middle, order, False, 0.0)))
        directions = heading(scan.stamp) + scan.angles
        aside = np.maximum(np.abs(np.cos(directions)), np.abs(np.sin(directions))) * scan.ranges - HALF
        bends.append(np.nanpercentile(np.abs(aside), 90))
    assert max(bends[:10]) > 0.05  # not known yet
    assert max(bends[-50:]) < 0.025
