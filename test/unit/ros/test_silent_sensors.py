"""A robot that stands for a sensor that died says so."""

from unittest import mock

from scan_source import StillFrames, scan_source
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.common.throttled_warnings import PERIOD, ThrottledWarnings
from mbf_relay.ros.costmap import inputs, node, publisher

DIED, BACK, END = 20, 29, 40
"""Seconds."""


class Frames(StillFrames):
    """Frames that all lie in one place, asked with conditions."""

    @staticmethod
    def lookup(*_, **__):
        return IDENTITY


def test_a_robot_that_stands_as_its_lidar_died_says_so_while_it_stands(monkeypatch):
    """It stood for a controller_patience of 15 s without a word: of what sends nothing no message is complained of."""
    now, said = [0.0], []
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(publisher.rospy, "Publisher", mock.MagicMock())
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: now[0])
    made = node.CostmapNode("local_costmap", {"local_costmap": {}}, Frames())
    made.costmap, lidar = scan_source(Frames(), patience=0.2, expected_update_rate=1.0)
    made._sensors["scan"] = lidar
    made._stale_warnings = ThrottledWarnings(lambda: now[0], lambda _, text: said.append((now[0], text)))
    monkeypatch.setattr(made, "_publisher", mock.MagicMock())
    monkeypatch.setattr(made, "_tracks", mock.MagicMock())
    for step in range(1, 5 * END):
        now[0] = 0.2 * step
        if not DIED <= now[0] < BACK:
            scan = LaserScan(angle_increment=0.1, range_min=0.1, range_max=3.5, ranges=[1.0 + 0.001 * step] * 62)
            scan.header.frame_id, scan.header.stamp = "laser", inputs.rospy.Time.from_sec(now[0])
            lidar._keep(scan)
        made._update(now[0])
    assert all(DIED < when < BACK and "'scan'" in text and "sent nothing" in text for when, text in said)
    assert [round(later - first, 1) for (first, _), (later, _) in zip(said, said[1:])] == [PERIOD]
