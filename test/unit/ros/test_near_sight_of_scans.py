"""Scans as they come, of a lidar that measures nothing nearer than 0.6 m."""

import math

import numpy as np
import pytest
import rospy
from scan_source import StillFrames, scan_source
from sensor_msgs.msg import LaserScan

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.costmap import inputs

BEAMS = 360
POST = slice(190, 200)
"""Beams that look at a post, ahead to the left."""


@pytest.mark.parametrize("nothing", [0.0, math.nan])
def test_what_came_nearer_than_the_lidar_can_see_stays_an_obstacle(monkeypatch, nothing):
    """Beams that pass beside it had it go; it goes once all of them look past."""
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    costmap, sensor = scan_source(StillFrames(), patience=0.2, clearing=True)

    def send(now, ranges):
        message = LaserScan(angle_min=-math.pi, angle_increment=2.0 * math.pi / BEAMS, range_min=0.6, range_max=3.5)
        message.header.frame_id, message.ranges = "laser", ranges
        message.header.stamp = rospy.Time.from_sec(now)
        monkeypatch.setattr(inputs.rospy, "get_time", lambda: now)
        sensor._keep(message)
        sensor.feed(now)
        costmap.update(now, IDENTITY)
        assert costmap.stale_reason(now) is None
        return int((costmap.snapshot().costs == LETHAL).sum())

    away = np.full(BEAMS, 3.0)
    seen, hidden = away.copy(), away.copy()
    seen[POST], hidden[POST] = 0.61, nothing
    marked = send(1.0, seen)
    assert marked > 1
    assert send(1.2, hidden) == send(1.4, hidden) == marked
    assert send(1.6, away) == 0
