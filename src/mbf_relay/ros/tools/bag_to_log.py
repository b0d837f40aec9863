"""bag_to_log.py: make a log for localize_log.py from a recorded bag."""

from __future__ import annotations

import argparse
import sys
from typing import Any, List, Optional, Tuple

import numpy as np
import rosbag
import rospy
import tf2_ros

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.logs import RecordedLog, save_log
from mbf_relay.ros.common.bags import find_scan_topic, open_bag, read_messages, sound_transforms
from mbf_relay.ros.common.checks import InvalidMessage, check_frames
from mbf_relay.ros.common.conversions import scan_from_message, transform_from_message
from mbf_relay.ros.common.lidar_geometry import mounting_of, seen_from_above


class BagReader:
    """Collects the rows of a log from a bag's transforms and scans.

    Attributes:
        left_out: The reason for each scan that was left out.
    """

    def __init__(self, scan_topic: str, base: str, odom: str, reference: Optional[Tuple[str, str]]) -> None:
        self._scan_topic, self._base, self._odom, self._reference = scan_topic, base, odom, reference
        self.left_out: List[str] = []
        self._buffer = tf2_ros.BufferCore(rospy.Duration(10 ** 9))

    def read(self, bag: rosbag.Bag) -> RecordedLog:
        """Return the log; raise ValueError where no scan has an odometry pose and a mounting."""
        messages = self._load(bag)
        rows: List[Tuple[float, Pose2D, np.ndarray, Optional[Pose2D]]] = []
        first, mount, lidar = None, None, ""
        for message in messages:
            try:
                odom = self._pose(self._odom, self._base, message.header.stamp)
                check_frames(message.header.frame_id)
                frame = message.header.frame_id.lstrip("/")
                if mount is None:
                    mount = mounting_of(self._buffer.lookup_transform_core(self._base, frame, rospy.Time(0)).transform)
                    lidar = frame
                if frame != lidar:
                    raise InvalidMessage(f"its lidar is '{frame}', and a log has one, here '{lidar}'")
                scan = seen_from_above(scan_from_message(message), mount[1])
                truth = self._pose(*self._reference, message.header.stamp) if self._reference else None
            except (tf2_ros.TransformException, InvalidMessage) as error:
                self.left_out.append(" ".join(str(error).split()))
                continue
            first = first or scan
            rows.append((scan.stamp, odom, scan.readings_at(first.angles), truth))
        if first is None or mount is None or not rows:
            raise ValueError(
                f"none of {len(messages)} scans on {self._scan_topic} can be related to '{self._odom}' by "
                f"'{self._base}'; are the frames named so in the bag?"
            )
        return RecordedLog(
            np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), np.array([row[2] for row in rows]),
            first.angle_min, first.angle_increment, first.range_max,
            np.array([row[3] for row in rows]) if self._reference else None, mount[0],
            first.range_min,
        )

    def _load(self, bag: rosbag.Bag) -> List[Any]:
        scans = []
        for topic, message, _ in read_messages(bag, ["tf", "/tf", "tf_static", "/tf_static", self._scan_topic]):
            if topic == self._scan_topic:
                scans.append(message)
                continue
            for transform in sound_transforms(message.transforms):
                setter = self._buffer.set_transform_static if topic.endswith("static") else self._buffer.set_transform
                setter(transform, "bag")
        return scans

    def _pose(self, parent: str, child: str, stamp: rospy.Time) -> Pose2D:
        return transform_from_message(self._buffer.lookup_transform_core(parent, child, stamp).transform)


def main(arguments: Optional[List[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 where the log cannot be made or written."""
    parser = argparse.ArgumentParser(prog="bag_to_log.py", description=__doc__)
    parser.add_argument("bag", metavar="BAG", help="the recorded bag")
    parser.add_argument("log", metavar="LOG.npz", help="the log to write")
    parser.add_argument("--scan", help="topic of the scans; needed if the bag has several")
    parser.add_argument("--base-frame", default="base_link", help="frame of the robot's base (default base_link)")
    parser.add_argument("--odom-frame", default="odom", help="frame of odometry (default odom)")
    parser.add_argument(
        "--ref", nargs=2, metavar=("MAP", "FRAME"),
        help="take the pose of FRAME in MAP, from the bag's /tf, as the true pose (`ref`)",
    )
    options = parser.parse_args(arguments)
    try:
        with open_bag(options.bag) as bag:
            topic = find_scan_topic(bag, options.scan, "choose one by --scan")
            reference = tuple(options.ref) if options.ref else None
            reader = BagReader(topic, options.base_frame, options.odom_frame, reference)
            log = reader.read(bag)
        save_log(options.log, log)
    except (OSError, ValueError) as error:
        print(f"bag_to_log.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    if reader.left_out:
        count, why = len(reader.left_out), reader.left_out[0]
        print(f"bag_to_log.py: {count} of {count + len(log)} scans left out, the first because {why}", file=sys.stderr)
    print(f"{len(log)} scans of {log.ranges.shape[1]} beams written to {options.log}")
    return 0
