"""Scans whose transform comes late, or never."""

import threading

import pytest
from scan_source import StillFrames, scan_source
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import IDENTITY
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.costmap import inputs

PERIOD, PATIENCE = 0.2, 0.5
"""Seconds from update to update, and those that a scan waits for its transform."""


class LateFrames(StillFrames):
    """Frames that are told of `late` s later."""

    def __init__(self, late):
        self.late, self.now = late, 0.0

    def lookup_message(self, _target, frame, when=None):
        if when is not None and when > self.now - self.late:
            raise TransformError(f"no transform from '{frame}'")
        return super().lookup_message()


class Lidar:
    """A lidar of some rate (Hz) before a costmap that is updated five times a second."""

    def __init__(self, monkeypatch, rate, late):
        monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
        monkeypatch.setattr(inputs.rospy, "get_time", lambda: self.frames.now)
        self.rate, self.frames = rate, LateFrames(late)
        self.costmap, self.sensor = scan_source(self.frames, PATIENCE)
        monkeypatch.setattr(self.sensor, "_require_sight", lambda *_: None)

    def run(self, seconds):
        """Send scans, and update; return how many scans waited at most."""
        most, begin = 0, self.frames.now
        for count in range(round(seconds / PERIOD)):
            for scan in range(round(PERIOD * self.rate)):
                self.frames.now = begin + count * PERIOD + (scan + 1) / self.rate
                message = LaserScan(angle_increment=0.1, range_min=0.1, range_max=3.5, ranges=[1.0] * 62)
                message.header.frame_id, message.header.stamp = "laser", inputs.rospy.Time.from_sec(self.frames.now)
                self.sensor._keep(message)
                most = max(most, len(self.sensor._waiting))
            self.sensor.feed(self.frames.now)
            self.costmap.update(self.frames.now, IDENTITY)
        return most


@pytest.mark.parametrize("rate", [5, 10, 20, 40])
def test_a_lidar_without_a_transform_is_named_however_fast_it_is(monkeypatch, rate):
    """Of one with 20 Hz it was said that it sent nothing: its newer scans displaced each before it was given up."""
    lidar = Lidar(monkeypatch, rate, late=100.0)
    lidar.run(3.0)
    assert "no transform from 'laser'" in (lidar.sensor.trouble or "nothing")
    assert "no transform from 'laser'" in lidar.costmap.stale_reason(lidar.frames.now)


@pytest.mark.parametrize("late", [0.1, 0.3, 0.45])
@pytest.mark.parametrize("rate", [5, 10, 20, 40])
def test_a_lidar_whose_transform_comes_late_is_used_however_fast_it_is(monkeypatch, rate, late):
    lidar = Lidar(monkeypatch, rate, late)
    most = lidar.run(3.0)
    assert lidar.costmap.stale_reason(lidar.frames.now) is None
    assert lidar.sensor.age(lidar.frames.now) <= late + 1.0 / rate + 0.01
    assert most <= rate * (PATIENCE + PERIOD) + 1


def test_of_two_lidars_on_a_topic_neither_drops_what_the_other_sent_at_that_moment(monkeypatch):
    """Each has a thread: the one that had looked at the clock, and went on after the other, found time set back."""
    lidar = Lidar(monkeypatch, 10.0, 0.0)

    def scan(frame):
        message = LaserScan(angle_increment=0.1, range_min=0.1, range_max=3.5, ranges=[1.0] * 62)
        message.header.frame_id, message.header.stamp = frame, inputs.rospy.Time(10)
        return message

    other = threading.Thread(target=lidar.sensor._keep, args=(scan("rear"),))

    def looks_and_waits():
        monkeypatch.setattr(inputs.rospy, "get_time", lambda: 10.1)
        other.start()
        other.join(0.5)
        return 10.0

    times = iter([lambda: 10.0, looks_and_waits])
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: next(times)())
    lidar.sensor._keep(scan("front"))
    other.join()
    assert sorted(entry.message.header.frame_id for entry in lidar.sensor._waiting) == ["front", "rear"]
