"""Two lidars on one topic: what one of them sees says nothing of the other."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.costmap import inputs

BEAMS = 180


class StillFrames:
    """Frames that all lie in one place."""

    def lookup_message(self, *_frames):
        message = TransformStamped()
        message.transform.rotation.w = 1.0
        return message


@pytest.fixture
def lidars(monkeypatch):
    """Return a costmap and a function that has a lidar send readings at a time."""
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    costmap = build_costmap("local_costmap", {
        "rolling_window": True, "width": 2.0, "height": 2.0, "plugins": [{"name": "o", "type": "ObstacleLayer"}],
        "o": {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "marking": True}}})
    source = costmap.sources["scan"]
    sensor = inputs.SensorInput("scan", source, costmap, StillFrames(), patience=0.2, max_age=1.0)
    monkeypatch.setattr(sensor, "_say", lambda reason: None)

    def send(stamp, frame, ranges):
        monkeypatch.setattr(inputs.rospy, "get_time", lambda: stamp)
        message = LaserScan(angle_min=-math.pi / 2, angle_increment=math.pi / BEAMS, range_min=0.1, range_max=3.5)
        message.header.frame_id, message.ranges = frame, ranges
        message.header.stamp = inputs.rospy.Time.from_sec(stamp)
        sensor._keep(message)
        sensor.feed(stamp)
        costmap.update(stamp, IDENTITY)

    return costmap, send


def test_a_robot_does_not_drive_on_when_the_front_one_of_its_two_lidars_delivers_nothing(lidars):
    costmap, send = lidars
    for count in range(1, 8):
        stamp = 0.2 * count
        send(stamp, "front", np.full(BEAMS, 2.0 if count < 5 else 0.0))
        if count >= 5:
            assert ("measures nothing in 100 % of its beams (the one of 2 in frame 'front'; if it was taken away for "
                    "good, start this node again)") in costmap.stale_reason(stamp)
        send(stamp + 0.05, "rear", np.full(BEAMS, 1.0))
        assert (costmap.stale_reason(stamp + 0.05) is None) == (count < 5)
    send(1.6, "front", np.full(BEAMS, 2.0))
    assert costmap.stale_reason(1.6) is None
