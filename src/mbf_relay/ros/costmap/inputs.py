"""A costmap's inputs: sensor messages, transformed to the costmap's frame once their transforms are there, and maps."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass, replace
from typing import Any, Callable, Deque, Dict, List, Optional, Set, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import LaserScan as LaserScanMessage
from sensor_msgs.msg import PointCloud, Range

from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.layer import MapSource
from mbf_relay.costmap.observation import Observation, observation_from_points, scan_points, unseen_points
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common import checks
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.clouds import cloud_points, rigid
from mbf_relay.ros.common.conversions import map_from_message, scan_from_message
from mbf_relay.ros.common.lidar_geometry import mounting_of, seen_from_above
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.common.quick_clouds import QuickCloud
from mbf_relay.ros.common.quick_grids import QuickGrid, QuickGridUpdate
from mbf_relay.ros.common.range_readings import range_points
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import ScanMonitor
from mbf_relay.senders import HOW_TO_GO_ON, Senders

BUFFER_BYTES = 1 << 24
"""Size of subscribers' receive buffers, enough for a large cloud or map."""
MOST_WAITING, MOST_OF_ONE = 50, 5
"""Largest number of waiting messages per source, and per sensor frame while they do not wait for tf, unless
observation_persistence needs them all."""
WARN_PERIOD = 5.0
"""Seconds between two warnings about the same source."""

MESSAGE_TYPES = {"LaserScan": LaserScanMessage, "PointCloud": PointCloud, "PointCloud2": QuickCloud, "Range": Range}
"""Message class by data_type."""
CLOUDS = ("PointCloud", "PointCloud2")
"""The data_types of clouds."""


@dataclass(eq=False)
class Waiting:
    """A waiting message.

    Attributes:
        arrived: Time (s) of its arrival.
        message: The message.
        for_tf: Whether its transform was missing at the last update. Newer messages do not displace it then: with late
            transforms, no message of a fast lidar would otherwise wait long enough to be used or reported.
    """

    arrived: float
    message: Any
    for_tf: bool = False


class SensorInput:
    """One observation source: the callback stores messages, `feed` takes those that can be transformed.

    Args:
        name: The source's name.
        parameters: Its parameters.
        costmap: What it feeds.
        transforms: Where frames are looked up.
        patience: Time (s) a message waits for its transform before it is given up.
        max_age: Age (s) above which a message is refused; 0 for no limit.
        timings: Corrects scans for the times of their beams.
    """

    def __init__(
        self, name: str, parameters: SourceParameters, costmap: Costmap, transforms: Transforms, patience: float,
        max_age: float, timings: LidarTimings,
    ) -> None:
        self._name, self._parameters, self._costmap, self._transforms = name, parameters, costmap, transforms
        self._timings = timings
        self._patience, self._max_age = patience, max_age or None
        self._lock = threading.Lock()  # guards the messages that wait; nothing else is locked while it is held
        self._waiting: Deque[Waiting] = deque(maxlen=MOST_WAITING)
        self._newest_alone = parameters.data_type in CLOUDS and parameters.observation_persistence == 0.0
        self._most = MOST_WAITING if parameters.observation_persistence > 0.0 else MOST_OF_ONE
        self._trouble: Optional[str] = None
        self._warnings = ThrottledWarnings()
        self._senders = Senders()
        self._monitors: Dict[str, ScanMonitor] = {}  # by frame, like the next one
        self._blind: Dict[str, str] = {}  # why a lidar's scans cannot be relied on
        self._used_since = math.inf
        self._used_last: Optional[float] = None
        self._topic = rospy.resolve_name(parameters.topic)
        self._subscriber = rospy.Subscriber(
            parameters.topic, MESSAGE_TYPES[parameters.data_type], self._keep, queue_size=MOST_WAITING,
            buff_size=BUFFER_BYTES, tcp_nodelay=True)

    @property
    def trouble(self) -> Optional[str]:
        """Why the last message was not used, None if it was."""
        return self._trouble

    def age(self, now: float) -> Optional[float]:
        """Return the age (s) of the last message that was used, None before the first."""
        return None if self._used_last is None else max(0.0, now - self._used_last)

    def close(self) -> None:
        """Listen no longer."""
        self._subscriber.unregister()

    def _keep(self, message: Any) -> None:
        try:
            checks.check_stamp(message.header.stamp.to_sec(), rospy.get_time(), self._max_age)
        except InvalidMessage as error:
            self._complain(f"refused: {error}")
            return
        with self._lock:
            now = rospy.get_time()  # under the lock: with two lidars' threads, time would seem to be set back
            if self._waiting and now < self._waiting[-1].arrived:
                self._waiting.clear()  # time was set back: waiting messages are from before
            frame = message.header.frame_id
            same = [entry for entry in self._waiting if entry.message.header.frame_id == frame and not entry.for_tf]
            if len(same) >= self._most:  # a fast lidar must not displace a slow one on its topic
                self._waiting.remove(same[0])
            self._waiting.append(Waiting(now, message))

    def feed(self, now: float) -> None:
        """Give the costmap all messages whose transforms are there; drop those that waited too long.

        Without observation_persistence only the newest cloud of each sensor is used, to avoid transforming megabytes
        that the costmap would forget at once.
        """
        with self._lock:
            waiting = list(self._waiting)
        if self._newest_alone:
            waiting.reverse()
        done: List[Waiting] = []
        newer: Set[str] = set()
        for entry in waiting:
            arrived, message = entry.arrived, entry.message
            if message.header.frame_id in newer:
                done.append(entry)
                continue
            try:
                observation = self._observation(message)
                measured = min(observation.stamp, arrived) if observation.stamp > 0.0 else arrived
                self._costmap.observe(self._name, replace(observation, stamp=measured), now)
                if self._newest_alone:
                    newer.add(message.header.frame_id)
                self._trouble = None
                self._used_since = min(self._used_since, arrived)
                self._used_last = measured
                self._refuse_blind()
                if self._trouble is None:
                    self._warnings.worked()
            except TransformError as error:
                if now - arrived <= self._patience:
                    entry.for_tf = True
                    continue
                if arrived >= self._used_since or self._used_since == math.inf:  # older ones came before tf
                    self._complain(f"dropped after {now - arrived:.2f} s: {error}")
            except BlindSensor:
                self._refuse_blind()
            except InvalidMessage as error:
                self._complain(f"refused: {error}")
            done.append(entry)
        with self._lock:
            kept = [entry for entry in self._waiting if entry not in done]
            self._waiting.clear()
            self._waiting.extend(kept)

    def _complain(self, reason: str) -> None:
        self._costmap.refuse(self._name, f"message {reason}", is_blind=False)
        self._say(reason)

    def _say(self, reason: str) -> None:
        self._trouble = f"source '{self._name}' on topic '{self._topic}': message {reason}"
        self._warnings.say(f"{self._costmap.name}: {self._trouble}")

    def _observation(self, message: Any) -> Observation:
        scan = scan_from_message(message) if isinstance(message, LaserScanMessage) else None
        frame, stamp = message.header.frame_id, message.header.stamp.to_sec()
        rides = self._transforms.rides_on(self._costmap.robot_frame, frame)
        mount, at_once = None, scan
        if scan is not None:
            mount = self._transforms.lookup_message(self._costmap.robot_frame, frame).transform
            if rides and stamp > 0.0:
                at_once = self._set_right(scan, mount)
                stamp = at_once.stamp
        when = stamp if stamp > 0.0 else None
        sensor = self._transforms.lookup_message(self._costmap.frame, frame, when)
        points, hits = points_from(message, at_once, self._parameters.inf_is_valid)
        if scan is not None:
            self._require_sight(scan, sensor, mount, rides)
        rotation, translation = rigid(sensor)
        seen = observation_from_points(points, hits, rotation, translation, stamp)
        unseen = None if at_once is None else unseen_points(at_once)
        if unseen is not None:
            unseen = unseen @ rotation[:, :2].T + translation
        base = self._transforms.lookup(self._costmap.frame, self._costmap.robot_frame, when) if rides else None
        seen = replace(seen, frame=frame.lstrip("/"), rides=rides, base=base, unseen=unseen)
        origin_frame = self._parameters.sensor_frame
        if not origin_frame or origin_frame == frame.lstrip("/"):
            return seen
        _, origin = rigid(self._transforms.lookup_message(self._costmap.frame, origin_frame, when))
        return replace(seen, origin=tuple(float(value) for value in origin))

    def _set_right(self, scan: LaserScan, mount: Transform) -> LaserScan:
        """Return a scan with all beams corrected to one time; `mount` is the transform from the lidar to the base."""
        _, upside_down = mounting_of(mount)
        return seen_from_above(self._timings.corrected(seen_from_above(scan, upside_down)), upside_down)

    def _require_sight(self, scan: LaserScan, sensor: TransformStamped, mount: Transform, rides: bool) -> None:
        """Raise BlindSensor where a scan shows that its lidar does not see.

        Args:
            scan: The scan as it came.
            sensor, mount: Transforms from its frame to the costmap's, and to the base's.
            rides: Whether the lidar moves with the robot.
        """
        frame = scan.frame.lstrip("/")
        pose, upside_down = mounting_of(sensor.transform)
        mounting, _ = mounting_of(mount)
        monitor = self._monitors.setdefault(frame, ScanMonitor(self._parameters.largest_gap))
        trouble = monitor.trouble(seen_from_above(scan, upside_down), -mounting.theta, pose)
        if monitor.takes_gaps_for_far:
            rospy.loginfo_once(
                "the lidar in frame '%s' has never sent inf and has no valid reading in many directions: they are "
                "taken for out of range (largest_gap)", frame)
        self._senders.hear(frame, scan.stamp, is_guest=not rides)
        self._blind.pop(frame, None)
        if trouble is not None:
            self._blind[frame] = trouble
            raise BlindSensor(trouble)

    def _refuse_blind(self) -> None:
        """Report the source as unreliable where one of the lidars on its topic does not see."""
        present = self._senders.present
        for frame in present:
            if frame in self._blind:
                which = f" (the one of {len(present)} in frame '{frame}'; {HOW_TO_GO_ON})" if len(present) > 1 else ""
                self._costmap.refuse(self._name, self._blind[frame] + which)
                self._say(f"cannot be relied on: {self._blind[frame]}{which}")


class BlindSensor(InvalidMessage):
    """A valid scan of a lidar that does not see, such as one that is covered."""


def points_from(
    message: Any, scan: Optional[LaserScan], inf_is_valid: bool
) -> Tuple[np.ndarray, Optional[np.ndarray]]:
    """Return a message's points in its own frame, (N, 2) or (N, 3) in m, and which are hits, (N,); None for all.

    Args:
        message: A PointCloud, PointCloud2, Range or LaserScan.
        scan: The converted LaserScan; None for the other types.
        inf_is_valid: See `scan_points`.

    Raises:
        InvalidMessage: The message cannot be read.
    """
    if scan is not None:
        return scan_points(scan, inf_is_valid)
    if isinstance(message, Range):
        return range_points(message, inf_is_valid)
    if isinstance(message, PointCloud):
        checks.check_count(len(message.points), checks.MOST_POINTS, "points in a cloud")
        return np.array([(point.x, point.y, point.z) for point in message.points]).reshape(-1, 3), None
    return cloud_points(message), None


class MapInput:
    """Subscribers of a map and its updates for one layer of a costmap.

    Args:
        layer: The layer's name.
        source: Topic of its map, and whether there are updates.
        costmap: The costmap of the layer.
        on_map: Called after each map, from rospy's thread.
        placing: Held while a map and its frame are taken.

    Attributes:
        frame: Frame of the map, None before the first.
    """

    def __init__(
        self, layer: str, source: MapSource, costmap: Costmap, on_map: Callable[[], None], placing: threading.Lock
    ) -> None:
        self.layer, self._source, self._costmap, self._on_map = layer, source, costmap, on_map
        self._placing = placing
        self.frame: Optional[str] = None
        self._subscribers = [
            rospy.Subscriber(source.topic, QuickGrid, self._take_map, queue_size=1, buff_size=BUFFER_BYTES)]
        if source.updates:
            self._subscribers.append(rospy.Subscriber(
                f"{source.topic}_updates", QuickGridUpdate, self._take_update, queue_size=10,
                buff_size=BUFFER_BYTES))

    def close(self) -> None:
        """Listen no longer."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _take_map(self, message: Any) -> None:
        if self.frame is not None and self._source.first_only:
            return
        try:
            occupancy = map_from_message(message)
            with self._placing:
                notice = self._costmap.set_map(occupancy, self.layer)
                self.frame = self._frame_of(message)
        except ValueError as error:
            rospy.logerr_throttle(
                WARN_PERIOD, f"{self._costmap.name}: map on topic '{self._source.topic}' refused: {error}")
            return
        if notice:
            rospy.logwarn("%s", notice)
        self._on_map()

    def _frame_of(self, message: Any) -> str:
        """Return the frame of a map; warn where it differs from the costmap's, unless that is a rolling window.

        As in costmap_2d, a costmap that takes its size from the map takes it to be in the costmap's own frame.
        """
        said, frame = message.header.frame_id.lstrip("/"), self._costmap.frame
        lies = frame if self._costmap.is_sized_by(self.layer) or not said else said
        if said != frame and lies != self.frame and not (said and self._costmap.parameters.rolling_window):
            rospy.logwarn(
                "%s: the map on topic '%s' is in frame '%s', not in '%s'; %s", self._costmap.name, self._source.topic,
                checks.shown(said), frame,
                f"it is used as if it were in '{frame}'" if lies == frame else "it is placed by their transform",
            )
        return lies

    def _take_update(self, message: Any) -> None:
        try:
            if message.width * message.height != len(message.data):
                raise InvalidMessage(f"{message.width} x {message.height} cells with {len(message.data)} values")
            data = np.array(message.data, dtype=np.int8).reshape(message.height, message.width)
            self._costmap.update_map(message.x, message.y, data, self.layer)
        except ValueError as error:
            rospy.logwarn_throttle(WARN_PERIOD, f"{self._costmap.name}: map update refused: {error}")
