"""amcl --run-from-bag: the node fed from a recorded bag, as fast as it goes."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any, List

import rosbag
import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

if TYPE_CHECKING:
    from mbf_relay.ros.amcl import AmclNode

BAG_CACHE_TIME = 10.0


def run_from_bag(node: "AmclNode", arguments: List[str]) -> None:
    """Play a bag's transforms and scans into the filter, publish them along, and say where the robot ended.

    Args:
        node: The node, not opened yet.
        arguments: What follows the program's name on the command line.

    Raises:
        OSError: The bag cannot be read.
        ValueError: It holds no scan.
    """
    parser = argparse.ArgumentParser(prog="amcl", description="Without options: run on topics.")
    parser.add_argument("--run-from-bag", dest="bag", required=True, metavar="BAG", help="bag with /tf and one topic of scans")
    parser.add_argument("--global-localization", action="store_true", help="start with particles all over the map")
    options = parser.parse_args(arguments)
    pause = float(rospy.get_param("~bag_scan_period", -1.0))
    began = time.monotonic()
    with open_bag(options.bag) as bag:
        scan_topic = find_scan_topic(bag)
        node.open()
        if options.global_localization:
            node.globalize()
        scans = _Player(node, scan_topic, pause).play(bag)
    rospy.loginfo("%d scans of %s took %.1f s", scans, options.bag, time.monotonic() - began)
    pose = node.pose()
    rospy.loginfo("final location %s", "unknown" if pose is None else "%.3f, %.3f, %.3f" % tuple(pose))
    rospy.signal_shutdown("the bag has ended")


def open_bag(path: str) -> rosbag.Bag:
    """Open a bag to read; OSError where there is none, ValueError where it is none."""
    try:
        return rosbag.Bag(path)
    except rosbag.ROSBagException as error:
        raise ValueError(f"bag {path} cannot be read: {error}") from error


def find_scan_topic(bag: rosbag.Bag) -> str:
    """Return the bag's topic of laser scans; `scan` as remapped where there are several.

    Raises:
        ValueError: It has none, or several of other names.
    """
    topics = bag.get_type_and_topic_info().topics
    scans = sorted(name for name, info in topics.items() if info.msg_type == "sensor_msgs/LaserScan")
    named = [name for name in scans if rospy.resolve_name(name) == rospy.resolve_name("scan")]
    if named or len(scans) == 1:
        return (named or scans)[0]
    raise ValueError(
        f"bag {bag.filename} has {', '.join(scans) or 'no topic'} with laser scans; remap 'scan' to the one to use"
    )


def as_tf2_wants(transform: Any) -> TransformStamped:
    """Return a bag's transform without the leading slashes of old frame names.

    A bag's messages are of classes made when it is read, which tf2 takes with a warning for each; so it gets its own.
    """
    header, moved, turned = transform.header, transform.transform.translation, transform.transform.rotation
    return TransformStamped(
        Header(header.seq, header.stamp, header.frame_id.lstrip("/")), transform.child_frame_id.lstrip("/"),
        Transform(Vector3(moved.x, moved.y, moved.z), Quaternion(turned.x, turned.y, turned.z, turned.w)),
    )


class _Player:
    """Hands a bag's messages to the node: transforms at once, scans when their transform has come."""

    def __init__(self, node: "AmclNode", scan_topic: str, pause: float) -> None:
        self._node, self._scan_topic, self._pause = node, scan_topic, pause
        self._scan_publisher = rospy.Publisher("scan", LaserScan, queue_size=100)
        self._tf_publisher = rospy.Publisher("/tf", TFMessage, queue_size=100)
        self._waiting: List[LaserScan] = []

    def play(self, bag: rosbag.Bag) -> int:
        """Play it all; return the number of scans."""
        count = 0
        for topic, message, _ in bag.read_messages(["tf", "/tf", "tf_static", "/tf_static", self._scan_topic]):
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
        transforms = [as_tf2_wants(transform) for transform in message.transforms]
        for transform in transforms:
            setter(transform, "bag")
        self._tf_publisher.publish(TFMessage(transforms))

    def _work(self) -> None:
        """Process what has its transform; what waits for longer than tf remembers will never have it."""
        while self._waiting and self._node.is_ready(self._waiting[0]):
            self._node.process(self._waiting.pop(0))
        newest = self._waiting[-1].header.stamp if self._waiting else rospy.Time(0)
        while self._waiting and (newest - self._waiting[0].header.stamp).to_sec() > BAG_CACHE_TIME:
            rospy.logwarn("no transform at the time of a scan (%.3f s); it is left out", self._waiting.pop(0).header.stamp.to_sec())
