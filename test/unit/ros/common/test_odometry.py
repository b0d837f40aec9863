"""Odometry of several nodes on one topic: the robot drives by one of them, and the log names both."""

import time
from types import SimpleNamespace

import pytest
import rospy
from nav_msgs.msg import Odometry
from ros_testing import as_received

from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common import odometry

NOW = 10.0


class Graph:
    """Nodes that publish odometry, some of them connected, and what the log says of it."""

    def __init__(self, monkeypatch):
        self.connected, self.warnings = ["/driver", "/stranger"], []
        self.wall, self.now = 100.0, NOW
        self._subscriber = SimpleNamespace(get_num_connections=lambda: len(self.connected))
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: self._subscriber)
        monkeypatch.setattr(rospy, "logwarn_throttle", lambda period, text: self.warnings.append(text))
        monkeypatch.setattr(odometry, "connected_nodes", lambda subscriber: dict.fromkeys(self.connected, ""))
        monkeypatch.setattr(time, "monotonic", lambda: self.wall)
        monkeypatch.setattr(rospy, "get_time", lambda: self.now)
        self.heard = odometry.OdometryInput("odom")

    def sends(self, sender, speed, stamp=NOW):
        """Have a node send its velocity; return the one that is taken for the robot's."""
        message = Odometry()
        message.header.stamp = rospy.Time.from_sec(stamp)
        message.twist.twist.linear.x = speed
        self.heard._take(as_received(message, odometry.RawOdometry, sender))
        return self.heard.read(NOW, 1.0)[2].x


@pytest.fixture
def graph(monkeypatch):
    return Graph(monkeypatch)


def test_a_robot_drives_on_by_its_own_odometry_where_a_stranger_sends_some_as_well(graph):
    """It swung to and fro, and the log told of wheels that might not be free."""
    assert graph.sends("/driver", 0.2) == 0.2
    for _ in range(3):
        assert graph.sends("/stranger", -1000.0) == 0.2
        assert graph.sends("/driver", 0.2) == 0.2
    assert set(graph.warnings) == {
        "odometry on /odom comes from /driver and from /stranger: only the first is heard; have the other publish "
        "elsewhere, or end it"}


def test_a_driver_that_is_started_anew_under_another_name_is_heard_at_once(graph):
    graph.sends("/driver_1", 0.2)
    graph.connected = ["/driver_2"]
    assert graph.sends("/driver_2", 0.1) == 0.1 and graph.warnings == []


def test_another_one_is_heard_where_the_first_has_fallen_silent(graph):
    graph.sends("/driver", 0.2)
    graph.wall += odometry.FALLEN_SILENT + 0.1
    assert graph.sends("/stranger", 0.1) == 0.1


def test_a_driver_that_does_not_name_itself_is_heard(graph):
    """TCPROS lets who publishes leave its name out; every message of such a one was an error in the log, and the robot
    stood."""
    assert [graph.sends(None, speed) for speed in (0.2, 0.1)] == [0.2, 0.1] and graph.warnings == []


def test_a_robot_whose_driver_tells_no_time_drives_by_what_has_just_come_and_stands_once_nothing_comes(graph):
    """It never set out: odometry was 1795751132.86 s old."""
    assert graph.sends("/driver", 0.2, stamp=0.0) == 0.2
    graph.now += 0.5
    assert graph.heard.read(graph.now, 1.0)[1] == NOW
    with pytest.raises(StaleDataError, match=r"is 1\.50 s old"):
        graph.heard.read(NOW + 1.5, 1.0)


@pytest.mark.parametrize("differ", [True, False])
def test_who_is_refused_odometry_of_another_clock_is_told_so(graph, differ):
    graph.sends("/driver", 0.2)
    graph.now += 1.5
    if differ:
        graph.sends("/driver", 0.2, stamp=graph.now - 1.5)
    with pytest.raises(StaleDataError, match=r"is 1\.50 s old") as refused:
        graph.heard.read(graph.now, 1.0)
    assert ("two clocks differ" in str(refused.value)) == differ


def test_a_robot_whose_driver_leaves_the_velocity_at_zeros_goes_by_its_poses_and_the_log_says_so(graph):
    """It was taken to stand: it crawled, and every 5 s its goal was recovered from being stuck."""
    for count in range(40):
        graph.now = NOW + 0.05 * count
        message = Odometry()
        message.header.stamp = rospy.Time.from_sec(graph.now)
        message.pose.pose.position.x = 0.02 * count
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = 0.01, 1.0
        graph.heard._take(as_received(message, odometry.RawOdometry, "/driver"))
        velocity = graph.heard.read(graph.now, 1.0)[2]
    assert velocity.x == pytest.approx(0.4, abs=1e-3)
    assert any("0.00" in text and "/odom send poses and a twist" in text for text in graph.warnings)
