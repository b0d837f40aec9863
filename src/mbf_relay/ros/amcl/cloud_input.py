"""Point clouds for localization, validated and converted to scans on arrival."""

from __future__ import annotations

from typing import Callable, NamedTuple, Union

import numpy as np
import rospy
from sensor_msgs.msg import LaserScan as LaserScanMessage
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.cloud_scan import CloudParameters, scan_of_points
from mbf_relay.ros.common.checks import check_frames
from mbf_relay.ros.common.clouds import cloud_points, rigid
from mbf_relay.ros.common.lidar_geometry import placed_when
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.quick_clouds import QuickCloud
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan

BUFFER_BYTES = 1 << 24
"""Size of the subscriber's receive buffer, enough for a large cloud."""


class CloudScan(NamedTuple):
    """A scan made from a point cloud: the cloud's header, the scan, and the pose of its frame in the base's."""

    header: Header
    scan: LaserScan
    laser_pose: Pose2D


AnyScan = Union[LaserScanMessage, CloudScan]
"""What waits in amcl's queue."""


class CloudInput:
    """Subscribes to `cloud_in`, of any number of sensors with different frames, and queues scans made from the clouds.

    Since a cloud is hundreds of times as large as a scan, it is converted on arrival, and dropped where its sensor's
    transform to the base is not known.
    """

    def __init__(
        self, values: CloudParameters, queue: MessageQueue, transforms: Transforms, base_frame: Callable[[], str]
    ) -> None:
        """Subscribe.

        Args:
            values: Which points of a cloud are used.
            queue: The queue of scans.
            transforms: Where frames are looked up.
            base_frame: Returns the frame of the robot's base.
        """
        self._values, self._queue, self._transforms, self._base_frame = values, queue, transforms, base_frame
        rospy.Subscriber(
            "cloud_in", QuickCloud, self._take, queue_size=10, buff_size=BUFFER_BYTES, tcp_nodelay=True
        )

    def _take(self, message: PointCloud2) -> None:
        self._queue.offer(
            message, rospy.get_time(),
            lambda cloud: scan_of_cloud(cloud, self._values, self._transforms, self._base_frame()))


def scan_of_cloud(
    message: PointCloud2, values: CloudParameters, transforms: Transforms, base_frame: str
) -> CloudScan:
    """Convert a cloud to a scan.

    Args:
        message: The cloud, in the frame of a sensor on the robot.
        values: Which of its points are used.
        transforms: Where frames are looked up.
        base_frame: Frame of the robot's base.

    Raises:
        InvalidMessage: The cloud cannot be read.
        TransformError: The sensor's frame is not connected to the base's.
    """
    check_frames(message.header.frame_id)
    points = cloud_points(message)
    stamp, frame = message.header.stamp.to_sec(), message.header.frame_id
    rotation, place = rigid(placed_when(stamp, frame, base_frame, transforms)[0])
    with np.errstate(invalid="ignore", over="ignore"):  # rows with NaN or infinity, which are left out
        in_base = points @ rotation.T + place
        scan = scan_of_points(in_base, place, values, stamp, frame)
    return CloudScan(message.header, scan, Pose2D(float(place[0]), float(place[1]), 0.0))
