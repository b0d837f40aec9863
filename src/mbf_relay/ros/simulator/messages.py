"""Conversions of the simulation's observations to messages."""

from __future__ import annotations

from typing import Iterable, List

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Quaternion, TwistWithCovariance, Vector3
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import Imu, JointState
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.ros.common.conversions import header, pose_to_message, twist_to_message
from mbf_relay.scan import LaserScan
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.drive import Odometry
from mbf_relay.simulation.imu import ImuReading
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.observations import JointReading

UNMEASURED = 1e6
"""Variance of z, roll and pitch, which a planar robot's odometry does not measure."""
PLANAR = (0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Indices of the covariances of x, y and yaw in the 36 elements of a 6 x 6 covariance."""
UNKNOWN = (14, 21, 28)
"""Indices of the variances of z, roll and pitch."""


def scan_to_message(scan: LaserScan, parameters: SimulatorParameters) -> LaserScanMessage:
    """Return a scan; `time_increment` is 0, for the stamp is the middle of the acquisition and holds for all beams."""
    message = LaserScanMessage(
        header=header(parameters.scan_frame, scan.stamp), angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1), angle_increment=scan.angle_increment,
        time_increment=0.0, scan_time=1.0 / parameters.scan_rate, range_min=scan.range_min, range_max=scan.range_max,
    )
    message.ranges = scan.ranges.tolist()
    return message


def odometry_to_message(odometry: Odometry, parameters: SimulatorParameters) -> OdometryMessage:
    """Return the odometry with its twist in the body's axes and both covariances filled."""
    message = odometry_message(
        odometry.pose, odometry.velocity, odometry.stamp, parameters.odom_frame, parameters.base_frame
    )
    message.pose.covariance = covariance_of_six(odometry.pose_covariance)
    message.twist.covariance = covariance_of_six(np.diag(odometry.velocity_variance))
    return message


def odometry_message(pose: Pose2D, velocity: Twist2D, stamp: float, frame: str, child_frame: str) -> OdometryMessage:
    """Return pose and velocity without covariances."""
    return OdometryMessage(
        header(frame, stamp), child_frame, PoseWithCovariance(pose=pose_to_message(pose)),
        TwistWithCovariance(twist=twist_to_message(velocity)),
    )


def imu_to_message(reading: ImuReading, parameters: SimulatorParameters) -> Imu:
    """Return a reading of the inertial sensor."""
    message = Imu(header=header(parameters.imu_frame, reading.stamp), orientation=Quaternion(*reading.orientation))
    message.angular_velocity = Vector3(*reading.turn_rate)
    message.linear_acceleration = Vector3(*reading.acceleration)
    message.orientation_covariance[0::4] = (1e-4,) * 3
    message.angular_velocity_covariance[0::4] = (max(reading.turn_rate_deviation ** 2, 1e-9),) * 3
    message.linear_acceleration_covariance[0::4] = (max(reading.acceleration_deviation ** 2, 1e-9),) * 3
    return message


def joints_to_message(reading: JointReading) -> JointState:
    """Return the wheels' angles and speeds."""
    return JointState(
        header=header("", reading.stamp), name=list(reading.names), position=list(reading.positions),
        velocity=list(reading.velocities),
    )


def contacts_to_message(contacts: Iterable[Contact], stamp: float, frame: str) -> MarkerArray:
    """Return contacts as markers, one for each: RViz shows where, `text` names the other body."""
    markers: List[Marker] = []
    for index, contact in enumerate(contacts):
        marker = Marker(header=header(frame, stamp), ns="contacts", id=index, type=Marker.SPHERE, action=Marker.ADD)
        marker.pose = Pose(Point(*contact.position), Quaternion(0.0, 0.0, 0.0, 1.0))
        marker.scale, marker.color = Vector3(0.05, 0.05, 0.05), ColorRGBA(1.0, 0.1, 0.1, 1.0)
        marker.lifetime, marker.text = rospy.Duration(1.0), contact.name
        markers.append(marker)
    return MarkerArray(markers)


def covariance_of_six(planar: np.ndarray) -> List[float]:
    """Return a message's 6 x 6 covariance, row by row, of one of x, y and heading, shape (3, 3)."""
    numbers = [0.0] * 36
    for place in UNKNOWN:
        numbers[place] = UNMEASURED
    for place, number in zip(PLANAR, planar.ravel().tolist()):
        numbers[place] = number
    return numbers
