"""amcl --run-from-bag: run the node on a recorded bag, as fast as possible."""

from __future__ import annotations

import time
from typing import List, Optional, Protocol

import rosbag
import rospy
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.bags import find_scan_topic, open_bag, read_messages, sound_transforms
from mbf_relay.ros.common.transforms import Transforms

BAG_CACHE_TIME = 10.0
"""Cache time (s) of tf2: a scan that has waited longer will never get its transform."""


class BagFed(Protocol):
    """Interface of a node that can be fed from a bag instead of topics."""

    transforms: Transforms

    def open(self) -> None:
        """Get the map, and advertise services and topics."""

    def globalize(self) -> None:
        """Spread the particles over the whole map."""

    def is_ready(self, message: LaserScan) -> bool:
        """Return whether a scan's transforms are there."""

    def process(self, message: LaserScan) -> None:
        """Process a scan whose transforms are there."""

    def pose(self) -> Optional[Pose2D]:
        """Return the estimated pose on the map, None before the first."""



def run_from_bag(node: BagFed, path: str, all_over: bool) -> None:
    """Feed a bag's transforms and scans to the filter, publish them too, and log the final pose.

    Args:
        node: The node, not opened yet.
        path: Path of the bag.
        all_over: Whether to start with particles all over the map.

    Raises:
        OSError: The bag cannot be read.
        ValueError: It is no bag, or `find_scan_topic` finds no topic of scans.
    """
    pause = float(rospy.get_param("~bag_scan_period", -1.0))
    began = time.monotonic()
    with open_bag(path) as bag:
        scan_topic = find_scan_topic(bag)
        node.open()
        if all_over:
            node.globalize()
        scans = _Player(node, scan_topic, pause).play(bag)
    rospy.loginfo("%d scans of %s took %.1f s", scans, path, time.monotonic() - began)
    pose = node.pose()
    rospy.loginfo("final location %s", "unknown" if pose is None else "{:.3f}, {:.3f}, {:.3f}".format(*pose))
    rospy.signal_shutdown("the bag has ended")


class _Player:
    """Gives a bag's messages to the node: transforms at once, scans when their transforms are there."""

    def __init__(self, node: BagFed, scan_topic: str, pause: float) -> None:
        self._node, self._scan_topic, self._pause = node, scan_topic, pause
        self._scan_publisher = rospy.Publisher("scan", LaserScan, queue_size=100)
        self._tf_publisher = rospy.Publisher("/tf", TFMessage, queue_size=100)
        self._waiting: List[LaserScan] = []

    def play(self, bag: rosbag.Bag) -> int:
        """Play it all; return the number of scans."""
        count = 0
        for topic, message, _ in read_messages(bag, ["tf", "/tf", "tf_static", "/tf_static", self._scan_topic]):
            if rospy.is_shutdown():
                break
            if topic == self._scan_topic:
                count += 1
                self._waiting.append(message)
                self._scan_publisher.publish(message)
                if self._pause > 0.0:
                    time.sleep(self._pause)
            else:
                self._take_transforms(message, static=topic.endswith("static"))
            self._work()
        return count

    def _take_transforms(self, message: TFMessage, static: bool) -> None:
        buffer = self._node.transforms.buffer
        setter = buffer.set_transform_static if static else buffer.set_transform
        transforms = list(sound_transforms(message.transforms))
        for transform in transforms:
            setter(transform, "bag")
        self._tf_publisher.publish(TFMessage(transforms))

    def _work(self) -> None:
        """Process waiting scans whose transforms are there; drop those older than tf2's cache time."""
        while self._waiting and self._node.is_ready(self._waiting[0]):
            self._node.process(self._waiting.pop(0))
        newest = self._waiting[-1].header.stamp if self._waiting else rospy.Time(0)
        while self._waiting and (newest - self._waiting[0].header.stamp).to_sec() > BAG_CACHE_TIME:
            rospy.logwarn(
                "scan of %.3f s is left out: the bag has no transform at its time",
                self._waiting.pop(0).header.stamp.to_sec(),
            )
