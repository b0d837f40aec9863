"""Conversions between ROS messages and the package's own types; incoming messages are validated here."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Twist, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_msgs.msg import Header

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.planning.path import Path
from mbf_relay.ros.common import checks
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.quick_grids import QuickGrid
from mbf_relay.scan import LaserScan


def yaw_from_quaternion(quaternion: Quaternion) -> float:
    """Return the yaw (rad, -pi to pi) of a quaternion, which need not be normalized.

    Raises:
        InvalidMessage: A component is not finite, or all are zero.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = checks.quaternion_length(quaternion)
    if not math.isfinite(norm) or norm < 1e-6:
        raise InvalidMessage(f"quaternion ({x}, {y}, {z}, {w}) is no rotation: it must be finite and not all zero")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_from_yaw(yaw: float) -> Quaternion:
    """Return the rotation about z by `yaw` (rad)."""
    return Quaternion(0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))


def pose_from_message(pose: Pose) -> Pose2D:
    """Return a message's pose in the plane.

    Raises:
        InvalidMessage: A number is NaN or infinite, the position is beyond FARTHEST, or the quaternion is all zero.
    """
    checks.check_place(pose.position.x, pose.position.y)
    return Pose2D(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation))


def pose_to_message(pose: Pose2D) -> Pose:
    """Return a pose in the plane as a message."""
    return Pose(Point(pose.x, pose.y, 0.0), quaternion_from_yaw(pose.theta))


def pose_stamped(pose: Pose2D, frame: str, stamp: Any) -> PoseStamped:
    """Return a pose with its frame and time (seconds or rospy.Time) as a message."""
    return PoseStamped(header(frame, stamp), pose_to_message(pose))


def dated(message: Any) -> Any:
    """Return a message with a header, stamped with the current time where its stamp is zero."""
    if message.header.stamp.is_zero():
        message.header.stamp = rospy.get_rostime()
    return message


def header(frame: str, stamp: Any) -> Header:
    """Return a header; `stamp` in seconds or as rospy.Time."""
    return Header(frame_id=frame, stamp=rospy.Time.from_sec(stamp) if isinstance(stamp, (int, float)) else stamp)


def take_transform(message: TransformStamped) -> None:
    """Check a transform's frames and numbers, and normalize its quaternion in place; its stamp is not checked here.

    tf2 accepts quaternions that are only nearly normalized and returns them as they are. Made into a matrix, such a
    quaternion scales the points it is applied to.

    Raises:
        InvalidMessage: A frame name is invalid, a number is not finite or too large, or the quaternion is no rotation.
    """
    checks.check_frames(message.header.frame_id, message.child_frame_id)
    moved, turned = message.transform.translation, message.transform.rotation
    checks.check_place(moved.x, moved.y, moved.z)
    length = checks.quaternion_length(turned)
    if not abs(length * length - 1.0) <= 0.01:  # tf2's own limit; tf2 prints its reason to stderr alone
        raise InvalidMessage(
            f"quaternion ({turned.x}, {turned.y}, {turned.z}, {turned.w}) has length {length:.3g}; a rotation's is 1")
    message.transform.rotation = Quaternion(
        turned.x / length, turned.y / length, turned.z / length, turned.w / length)


def transform_from_message(transform: Transform) -> Pose2D:
    """Return the planar part of a transform: x, y (m) and yaw (rad)."""
    return Pose2D(transform.translation.x, transform.translation.y, yaw_from_quaternion(transform.rotation))


def transform_to_message(pose: Pose2D) -> Transform:
    """Return a pose in the plane as a transform message."""
    return Transform(Vector3(pose.x, pose.y, 0.0), quaternion_from_yaw(pose.theta))


def twist_from_message(twist: Twist) -> Twist2D:
    """Return the planar part of a twist (m/s, rad/s); raise InvalidMessage where it is not finite or beyond FASTEST."""
    velocity = Twist2D(twist.linear.x, twist.linear.y, twist.angular.z)
    checks.check_velocity(velocity)
    return velocity


def twist_to_message(velocity: Twist2D) -> Twist:
    """Return a planar velocity as a message."""
    return Twist(Vector3(velocity.x, velocity.y, 0.0), Vector3(0.0, 0.0, velocity.theta))


def path_from_message(message: PathMessage) -> Path:
    """Return a path in the frame of its header; the frames of its poses are ignored.

    Many clients and planners leave quaternions at zeros; such a pose is turned towards the next one. The last pose must
    have a rotation, as the robot turns to it at the goal.

    Raises:
        InvalidMessage: There are too many poses, one is not finite, or the last has no rotation; the text says which.
    """
    checks.check_count(len(message.poses), checks.MOST_POSES, "poses in a path")
    poses = np.empty((len(message.poses), 3))
    following = message.poses[1:] + [None]
    for index, (stamped, after) in enumerate(zip(message.poses, following)):
        try:
            poses[index] = _pose_before(stamped.pose, after.pose.position) if after else pose_from_message(stamped.pose)
        except InvalidMessage as error:
            raise InvalidMessage(f"pose {index} of the path: {error}") from error
    return Path(poses, message.header.frame_id)


def _pose_before(pose: Pose, after: Point) -> Pose2D:
    """Return a pose of a path, turned towards the next position `after` where its quaternion is all zero."""
    turned = pose.orientation
    if any((turned.x, turned.y, turned.z, turned.w)):
        return pose_from_message(pose)
    checks.check_place(pose.position.x, pose.position.y)
    return Pose2D(
        pose.position.x, pose.position.y, math.atan2(after.y - pose.position.y, after.x - pose.position.x))


def path_to_message(path: Path, stamp: Any) -> PathMessage:
    """Return a path as a message; `stamp` in seconds or as rospy.Time."""
    top = header(path.frame, stamp)
    return PathMessage(top, [PoseStamped(top, pose_to_message(Pose2D(*map(float, pose)))) for pose in path.poses])


def map_from_message(message: OccupancyGrid) -> OccupancyMap:
    """Return an occupancy map.

    Raises:
        InvalidMessage: It is empty or too large, its resolution is out of range, its size does not fit its data, or its
            origin is invalid.
    """
    info = message.info
    checks.check_map(info, len(message.data))
    data = np.array(message.data, dtype=np.int8).reshape(info.height, info.width)
    # the message holds a float32: 0.05 arrives as 0.0500000007 and is rounded back to 0.05
    resolution = float(str(np.float32(info.resolution)))
    return OccupancyMap(data, resolution, pose_from_message(info.origin))


def map_to_message(occupancy: OccupancyMap, frame: str, stamp: Any) -> OccupancyGrid:
    """Return an occupancy map as a message; `stamp` in seconds or as rospy.Time."""
    top = header(frame, stamp)
    height, width = occupancy.data.shape
    info = MapMetaData(top.stamp, occupancy.resolution, width, height, pose_to_message(occupancy.origin))
    return QuickGrid(top, info, occupancy.data.ravel())


def scan_from_message(message: LaserScanMessage) -> LaserScan:
    """Return a laser scan, with range_max cut to LONGEST_RANGE.

    Raises:
        InvalidMessage: It has no beams, its angles or limits are invalid, or its ranges must be in millimetres.
    """
    checks.check_scan(message)
    ranges = np.array(message.ranges, dtype=np.float64)
    checks.check_readings(ranges)
    return LaserScan(
        ranges, message.angle_min, message.angle_increment, message.range_min,
        min(message.range_max, checks.LONGEST_RANGE), message.header.stamp.to_sec(), message.header.frame_id,
        _sweep_time(message),
    )


def _sweep_time(message: LaserScanMessage) -> float:
    """Return the time (s) of all a scan's beams as its time_increment has it; 0 where scan_time does not bear that out.

    Drivers mean by scan_time the time of these beams, or of a whole turn. That of the XV-11, among others, leaves it at
    0, and what it gives as time_increment is the motor's speed in a unit of its own.
    """
    beams = len(message.ranges)
    told, share = abs(message.time_increment) * beams, abs(message.angle_increment) * beams / (2.0 * math.pi)
    is_borne_out = any(abs(whole - told) < 0.1 * told for whole in (message.scan_time, share * message.scan_time))
    return told if is_borne_out else 0.0
