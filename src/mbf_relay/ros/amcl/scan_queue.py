"""Scans wait here until the odometry of their time is known."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Union

import rospy
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_msgs.msg import Header

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage, check_stamp
from mbf_relay.ros.common.conversions import dated
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.scan import LaserScan

_ONE_SECOND = rospy.Duration(1.0)


class CloudScan(NamedTuple):
    """What a point cloud came to: its header, a scan, and the pose of the scan's frame in the base's."""

    header: Header
    scan: LaserScan
    laser_pose: Pose2D


AnyScan = Union[LaserScanMessage, CloudScan]


class ScanQueue:
    """Scans in the order of their coming, given out once their transform is there.

    Callbacks put, one worker takes. Of several scans of one lidar that are ready together only the newest is given:
    the filter moves by odometry, and a scan it is late for would only make it later.
    """

    def __init__(self, length: int = 100, warnings: Optional[ThrottledWarnings] = None) -> None:
        self._changed = threading.Condition()  # guards all below; nothing else is locked while it is held
        self._has_news = False
        self._waiting: Deque[AnyScan] = deque(maxlen=length)
        self._warnings = warnings or ThrottledWarnings()

    def offer(self, message: Any, now: float, make: Callable[[Any], AnyScan] = lambda message: message) -> None:
        """Add what a sensor sent, or tell why it is refused: not where that is over at once, as at a graph's start.

        Args:
            message: With a header.
            now: The clock (s), 0 before its first message.
            make: Makes a scan of it.
        """
        try:
            check_stamp(message.header.stamp.to_sec(), now)
            self.put(make(dated(message)))
        except (InvalidMessage, TransformError) as error:
            self._warnings.say(f"a message of {message._type} refused: {error}")
        else:
            self._warnings.worked()

    def put(self, message: AnyScan) -> None:
        """Add a scan; the oldest goes where there is no room."""
        with self._changed:
            if self._waiting and message.header.stamp + _ONE_SECOND < self._waiting[-1].header.stamp:
                self._waiting.clear()  # time was set back: what waits belongs to a world that is over
            self._waiting.append(message)
            self._has_news = True
            self._changed.notify()

    def look_again(self) -> None:
        """Have what waits asked again whether it is ready; call when transforms have come."""
        with self._changed:
            if self._waiting:
                self._has_news = True
                self._changed.notify()

    def take(self, is_ready: Callable[[AnyScan], bool], timeout: float) -> List[AnyScan]:
        """Return the newest ready scan of each frame; nothing where none is, after news or `timeout` wall seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._has_news, timeout)
            self._has_news = False
            waiting = list(self._waiting)
        ready: Dict[str, AnyScan] = {
            message.header.frame_id: message for message in waiting if is_ready(message)
        }
        with self._changed:
            newest = {frame: message.header.stamp for frame, message in ready.items()}
            left = [
                m
                for m in self._waiting
                if m.header.frame_id not in newest or m.header.stamp > newest[m.header.frame_id]
            ]
            self._waiting.clear()
            self._waiting.extend(left)
        return sorted(ready.values(), key=lambda message: message.header.stamp)

    def oldest(self) -> Optional[AnyScan]:
        """Return the scan that has waited longest, None where none waits."""
        with self._changed:
            return self._waiting[0] if self._waiting else None
