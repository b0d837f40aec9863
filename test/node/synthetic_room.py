"""A synthetic room and a robot in it for the localization tests: tf, odometry and scans without physics."""

import math
import threading

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.conversions import header, pose_to_message, transform_to_message
from mbf_relay.ros.common.transforms import TransformPublisher

BEAMS = 120


def synthetic_room():
    """Return a room of 10 m x 6 m without symmetry, 0.05 m cells, lower left corner at (-2, -1)."""
    data = np.zeros((120, 200), dtype=np.int8)
    data[:2] = data[-2:] = 100
    data[:, :2] = data[:, -2:] = 100
    data[40:60, 60:70] = 100
    data[90:118, 120:124] = 100
    data[20:30, 150:170] = 100
    return OccupancyMap(data, 0.05, Pose2D(-2.0, -1.0, 0.0))


def initial_pose_message(pose, stamp=None, variance=0.01, frame="map"):
    """Return what RViz says on 2D Pose Estimate; `variance` in m^2 and rad^2, stamped now where `stamp` is None."""
    message = PoseWithCovarianceStamped(header=header(frame, rospy.get_rostime() if stamp is None else stamp))
    message.pose.pose = pose_to_message(pose)
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = variance
    message.pose.covariance = covariance.tolist()
    return message


class RoomRobot:
    """Stands or drives in the room, with a lidar that can be changed by the test."""

    def __init__(self, occupancy, pose, lidars=(("base_scan", "scan", Pose2D(-0.03, 0.0, 0.0), False),), rate=10.0):
        self.field = DistanceField(occupancy, 2.0)
        self.pose = pose
        self.odom_in_map = pose.compose(Pose2D(0.3, -0.2, 0.5))  # odometry starts anywhere
        self.velocity = (0.0, 0.0)
        self.scanning = True
        self.change_ranges = lambda ranges: ranges
        self.change_message = lambda message: message
        self.lidars = lidars
        self._publishers = {frame: rospy.Publisher(topic, LaserScan, queue_size=5) for frame, topic, _, _ in lidars}
        self._tf = TransformPublisher()
        self._static = tf2_ros.StaticTransformBroadcaster()
        self.announce()
        self._rng = np.random.default_rng(5)
        self._period = 1.0 / rate
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def announce(self):
        """Tell where the lidars sit."""
        now = rospy.get_rostime()
        self._static.sendTransform(
            [mounting(frame, pose, down, "base_footprint", now) for frame, _, pose, down in self.lidars])

    def stop(self):
        self._stop.set()
        self._thread.join()

    @property
    def odom_pose(self):
        return self.pose.relative_to(self.odom_in_map)

    def _run(self):
        while not self._stop.wait(self._period):
            forward, turn = self.velocity
            self.pose = self.pose.compose(Pose2D(forward * self._period, 0.0, turn * self._period))
            now = rospy.get_rostime()
            self._tf.send("odom", "base_footprint", self.odom_pose, now)
            if self.scanning:
                for frame, _, mount, upside_down in self.lidars:
                    message = lidar_message(self.field, self.pose, frame, mount, upside_down, now, self._rng)
                    message.ranges = self.change_ranges(np.array(message.ranges)).tolist()
                    self._publishers[frame].publish(self.change_message(message))


def mounting(frame, pose, upside_down, base, stamp):
    """Return the transform of a lidar on its robot; one that hangs upside down is rolled by half a turn."""
    message = TransformStamped(header(base, stamp), frame, transform_to_message(pose))
    if upside_down:
        rotation = message.transform.rotation
        rotation.x, rotation.y = math.cos(pose.theta / 2.0), math.sin(pose.theta / 2.0)
        rotation.z = rotation.w = 0.0
    return message


def lidar_message(field, robot, frame, mount, upside_down, stamp, rng):
    """Return what a lidar mounted so on a robot sees."""
    increment = 2.0 * math.pi / BEAMS
    bearings = np.arange(BEAMS) * (-increment if upside_down else increment)
    ranges = np.empty(BEAMS)
    cast_scan(np.array([robot.compose(mount)]), field.blocked, field.frame, 5.0, bearings, ranges)
    message = LaserScan(header=header(frame, stamp), angle_min=0.0, angle_max=2.0 * math.pi - increment)
    message.angle_increment, message.range_min, message.range_max = increment, 0.12, 5.0
    message.ranges = np.where(ranges < 5.0, ranges + rng.normal(0.0, 0.01, BEAMS), np.inf).tolist()
    return message
