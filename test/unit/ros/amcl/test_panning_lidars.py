"""A lidar that pans on its robot, and is dated by another clock, is seen by amcl where it looked."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.ros.amcl.health import ScanWatch
from mbf_relay.ros.amcl.node import AmclNode
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.scan_timing import ScanTiming

LATE = 0.3


class Panning:
    """Transforms of a robot that drives at 1 m/s while its lidar pans at 1 rad/s."""

    def lookup(self, _target, _source, stamp):
        return Pose2D(stamp, 0.0, 0.0)

    def lookup_message(self, _base, _frame, stamp=10.0, **_):
        placed = TransformStamped()
        placed.header.stamp = rospy.Time.from_sec(stamp)
        placed.transform.rotation.z, placed.transform.rotation.w = np.sin(0.5 * stamp), np.cos(0.5 * stamp)
        return placed

    def frames_above(self, *_):
        return []


def test_a_lidar_that_pans_is_seen_where_it_looked_and_the_robot_where_it_was_at_one_time():
    """The robot was put where it had been, and its lidar 0.3 s later: walls lay as far aside as it had turned since."""
    node, taken = AmclNode.__new__(AmclNode), []
    timings = LidarTimings(Panning(), lambda: ("base_link", "odom"))
    timings._timings["laser"] = ScanTiming()
    timings._timings["laser"].late = LATE
    node.__dict__.update(
        _parameters=AmclParameters(save_pose_rate=0.0), _lock=threading.RLock(), _kept=None, _scan_watch=ScanWatch(),
        _timings=timings, transforms=Panning(), _saved_pose=SimpleNamespace(take_turn=lambda *_: False),
        _localizer=SimpleNamespace(
            process=lambda *values: taken.append(values), odometry=SimpleNamespace(jumps=0), map_from_odom=None,
            poses=None, searched=1.0))
    message = LaserScan(ranges=[2.0] * 8, angle_increment=0.7, range_max=3.0)
    message.header.frame_id, message.header.stamp = "laser", rospy.Time(9)
    node.process(message)
    ((odom_pose, scan, laser_pose),) = taken
    assert scan.stamp == odom_pose.x == pytest.approx(9.0 - LATE)
    assert np.exp(1j * laser_pose.theta) == pytest.approx(np.exp(1j * (9.0 - LATE)))
