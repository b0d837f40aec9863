"""Clouds of a depth camera that is faster than the costmap."""

import numpy as np
import pytest
from scan_source import StillFrames
from sensor_msgs.msg import PointCloud2, PointField

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.costmap import inputs


class LateFrames(StillFrames):
    """Frames that are told of `late` s later."""

    def __init__(self):
        self.late, self.now = 0.0, 0.0

    def lookup_message(self, _target, frame, when=None):
        if when is not None and when > self.now - self.late + 1e-6:
            raise TransformError(f"no transform from '{frame}'")
        return super().lookup_message()


class Camera:
    """One of 20 Hz before a costmap that is updated five times a second; what it sees comes nearer by the second."""

    def __init__(self, monkeypatch, **source):
        monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
        monkeypatch.setattr(inputs.rospy, "get_time", lambda: self.frames.now)
        self.frames, self.read, self.seen = LateFrames(), 0, []
        self.costmap = build_costmap("local_costmap", {
            "rolling_window": True, "width": 4.0, "height": 4.0, "plugins": [{"name": "o", "type": "ObstacleLayer"}],
            "o": {"observation_sources": "cloud", "cloud": {"data_type": "PointCloud2", "marking": True, **source}}})
        self.sensor = inputs.SensorInput(
            "cloud", self.costmap.sources["cloud"], self.costmap, self.frames, 0.5, max_age=1.0,
            timings=LidarTimings(self.frames, lambda: (self.costmap.robot_frame, self.costmap.frame)))
        observe, read = self.costmap.observe, inputs.points_from
        monkeypatch.setattr(self.costmap, "observe", lambda *given: (self.seen.append(given[1].stamp), observe(*given)))
        monkeypatch.setattr(inputs, "points_from", lambda *given: (self._count(), read(*given))[1])

    def _count(self):
        self.read += 1

    def run(self, seconds, frames=("camera",)):
        begin = self.frames.now
        for count in range(1, round(20 * seconds) + 1):
            self.frames.now = begin + count / 20.0
            for frame in frames:
                points = np.array([[1.5 - 0.5 * self.frames.now, 0.0, 0.3]], np.float32)
                message = PointCloud2(height=1, width=1, point_step=12, row_step=12, data=points.tobytes())
                message.fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate("xyz")]
                message.header.frame_id = frame
                message.header.stamp = inputs.rospy.Time.from_sec(self.frames.now)
                self.sensor._keep(message)
            if count % 4 == 0:
                self.sensor.feed(self.frames.now)
                self.costmap.update(self.frames.now, IDENTITY)

    @property
    def age(self):
        return self.frames.now - self.seen[-1]


def test_a_cloud_that_a_newer_one_replaces_is_not_read(monkeypatch):
    """Of a depth camera's 15 clouds a second ten were turned into 300 000 points each, and then forgotten."""
    camera = Camera(monkeypatch)
    camera.run(2.0)
    assert camera.read == len(camera.seen) == 10
    assert camera.seen == pytest.approx(np.arange(1, 11) / 5.0)


def test_where_old_clouds_count_each_is_read(monkeypatch):
    camera = Camera(monkeypatch, observation_persistence=1.0)
    camera.run(2.0)
    assert camera.read == 40 and camera.seen == sorted(camera.seen)


def test_of_two_cameras_on_a_topic_each_one_s_newest_is_read(monkeypatch):
    camera = Camera(monkeypatch)
    camera.run(2.0, frames=("left", "right"))
    assert camera.read == 20


@pytest.mark.parametrize("late", [0.05, 0.12, 0.3])
def test_where_transforms_come_late_the_newest_that_has_one_is_seen(monkeypatch, late):
    camera = Camera(monkeypatch)
    camera.frames.late = late
    camera.run(3.0)
    assert camera.seen == sorted(camera.seen) and len(camera.seen) == len(set(camera.seen))
    assert camera.age <= late + 0.05 + 1e-6
    assert camera.costmap.stale_reason(camera.frames.now) is None
