"""Conversion of initial poses: frame and numbers are checked, and odometry's motion since the stamp is added."""

from __future__ import annotations

from typing import Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage, shown
from mbf_relay.ros.common.conversions import pose_from_message, transform_from_message
from mbf_relay.ros.common.transforms import Transforms


def check_frame(message: PoseWithCovarianceStamped, global_frame: str) -> None:
    """Raise InvalidMessage where a pose is in another frame than the map's; without a frame it is taken, as in amcl."""
    frame = message.header.frame_id.lstrip("/")
    if not frame:
        rospy.logwarn("initial pose has no frame_id and is taken in '%s'; have its sender set one", global_frame)
    elif frame != global_frame:
        raise InvalidMessage(f"it is in frame '{shown(frame)}'; it must be in '{global_frame}'")


def initial_pose_from_message(message: PoseWithCovarianceStamped, motion: Pose2D) -> Tuple[Pose2D, np.ndarray]:
    """Return the pose the robot has now, and the covariance, shape (3, 3).

    Args:
        message: The robot's pose at the message's stamp.
        motion: Motion of the base since then, in its frame at that time.

    Raises:
        InvalidMessage: The pose is not finite.
    """
    covariance = np.array(message.pose.covariance, dtype=float).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    covariance[:2, 2] = covariance[2, :2] = 0.0  # amcl reads no more of it
    return pose_from_message(message.pose.pose).compose(motion), covariance


def motion_since(stamp: rospy.Time, transforms: Transforms, odom_frame: str, base_frame: str) -> Pose2D:
    """Return the base's motion from `stamp` to now, in its frame at `stamp`.

    It is the identity for a stamp of zero or newer than odometry, as from RViz, without odometry, and, with a warning,
    where odometry does not reach back to the stamp.
    """
    try:
        newest = transforms.lookup_message(odom_frame, base_frame)
    except TransformError:
        return IDENTITY  # no odometry yet: the robot has not been seen to move
    if stamp.is_zero() or stamp >= newest.header.stamp:
        return IDENTITY
    try:
        then = transforms.lookup(odom_frame, base_frame, stamp.to_sec())
    except TransformError as error:
        rospy.logwarn("initial pose is taken as the pose now: the motion since its stamp is not known: %s", error)
        return IDENTITY
    return transform_from_message(newest.transform).relative_to(then)
