"""Recorded bags: opened with errors a user can mend, and their transforms as tf2 takes them."""

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
    """Open a bag to read; OSError where there is none, ValueError where it is none."""
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
    """Return a bag's messages as rosbag does; ValueError where a part of it is broken."""
    try:
        yield from bag.read_messages(topics)
    except (rosbag.ROSBagException, genpy.DeserializationError, struct.error, LookupError, ValueError, TypeError,
            AttributeError, EOFError, OSError, MemoryError, SyntaxError, zlib.error) as error:
        raise ValueError(f"bag {bag.filename} is broken: {type(error).__name__}: {error}") from error


def find_scan_topic(
    bag: rosbag.Bag, wanted: Optional[str] = None, choice: str = "remap 'scan' to the one to use"
) -> str:
    """Return the bag's topic of laser scans; `scan` as remapped where there are several.

    Args:
        bag: The bag.
        wanted: The one a user names, with or without its first slash, as bags have them.
        choice: How a user names one.

    Raises:
        ValueError: It has none, not the one that is wanted, or several of other names.
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
    """Return the transforms of a bag's message that tf2 survives, without leading slashes.

    Others are left out and named.
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
    """Return a bag's transform without the leading slashes of old frame names.

    A bag's messages are of classes made when it is read, which tf2 takes with a warning for each; so it gets its own.
    """
    header, moved, turned = transform.header, transform.transform.translation, transform.transform.rotation
    return TransformStamped(
        Header(header.seq, header.stamp, header.frame_id.lstrip("/")), transform.child_frame_id.lstrip("/"),
        Transform(Vector3(moved.x, moved.y, moved.z), Quaternion(turned.x, turned.y, turned.z, turned.w)),
    )
