"""Reading rosbags: errors that tell a user what to do, the topic with laser scans, and transforms that tf2 can take."""

from __future__ import annotations

import struct
import sys
import zlib
from typing import Any, Iterable, Iterator, List, Optional

import genpy
import rosbag
import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from std_msgs.msg import Header

from mbf_relay import files
from mbf_relay.ros.common.checks import InvalidMessage, check_time
from mbf_relay.ros.common.conversions import take_transform


def open_bag(path: str) -> rosbag.Bag:
    """Open a bag for reading.

    Raises:
        OSError: There is no such file, or it cannot be opened.
        ValueError: The file is no bag, is damaged, or has no index yet.
    """
    files.open_regular(path, sys.maxsize).close()
    try:
        return rosbag.Bag(path)
    except rosbag.ROSBagUnindexedException as error:
        raise ValueError(
            f"bag {path} was not closed, as its recorder was killed or still runs; `rosbag reindex {path}` mends it"
        ) from error
    except (
        rosbag.ROSBagException,
        struct.error,
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        MemoryError,
    ) as error:
        raise ValueError(f"bag {path} cannot be read: {error or type(error).__name__}") from error


def read_messages(bag: rosbag.Bag, topics: Optional[List[str]] = None) -> Iterator[Any]:
    """Yield (topic, message, time) as rosbag does; raise ValueError where a part of the bag is damaged."""
    try:
        yield from bag.read_messages(topics)
    except (rosbag.ROSBagException, genpy.DeserializationError, struct.error, LookupError, ValueError, TypeError,
            AttributeError, EOFError, OSError, MemoryError, SyntaxError, zlib.error) as error:
        raise ValueError(f"bag {bag.filename} is broken: {type(error).__name__}: {error}") from error


def find_scan_topic(
    bag: rosbag.Bag, wanted: Optional[str] = None, choice: str = "remap 'scan' to the one to use"
) -> str:
    """Return the name of the bag's topic with laser scans.

    That is the topic `wanted`; without it the topic `scan`, as remapped, else the only one of that type.

    Args:
        bag: The bag.
        wanted: Topic given by the user, with or without its leading slash.
        choice: For the error's text: what the user can do to choose a topic.

    Raises:
        ValueError: The bag has no laser scans, none on `wanted`, or several such topics and none of them is `scan`.
    """
    topics = bag.get_type_and_topic_info().topics
    scans: List[str] = sorted(name for name, info in topics.items() if info.msg_type == "sensor_msgs/LaserScan")
    named = [name for name in scans if rospy.resolve_name(name) == rospy.resolve_name(wanted or "scan")]
    if named or (len(scans) == 1 and wanted is None):
        return (named or scans)[0]
    raise ValueError(
        f"bag {bag.filename} has {', '.join(scans) or 'no topic'} with laser scans; {choice}"
    )


def sound_transforms(transforms: Iterable[Any]) -> Iterator[TransformStamped]:
    """Yield the valid transforms of a TFMessage from a bag, without leading slashes; warn of those that are left out.
    """
    for transform in transforms:
        try:
            take_transform(transform)
            check_time(transform.header.stamp.to_sec())
        except InvalidMessage as error:
            rospy.logwarn_once(
                f"left out a transform from '{transform.header.frame_id}' to '{transform.child_frame_id}': {error}"
            )
            continue
        yield as_tf2_wants(transform)


def as_tf2_wants(transform: Any) -> TransformStamped:
    """Return a bag's transform as a geometry_msgs/TransformStamped, without the leading slashes of old frame names.

    rosbag generates its message classes when it reads a bag; tf2 warns of each such message.
    """
    header, moved, turned = transform.header, transform.transform.translation, transform.transform.rotation
    return TransformStamped(
        Header(header.seq, header.stamp, header.frame_id.lstrip("/")), transform.child_frame_id.lstrip("/"),
        Transform(Vector3(moved.x, moved.y, moved.z), Quaternion(turned.x, turned.y, turned.z, turned.w)),
    )
