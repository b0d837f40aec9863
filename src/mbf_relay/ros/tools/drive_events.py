"""Conversion of messages, of a running graph or of a bag, to the events of a drive."""

from __future__ import annotations

from functools import partial
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped

from mbf_relay.geometry import Pose2D
from mbf_relay.report.drive import Drive, GoalRecord
from mbf_relay.report.drive_log import DriveLog
from mbf_relay.ros.common import conversions
from mbf_relay.ros.common.bags import open_bag, read_messages, sound_transforms
from mbf_relay.ros.common.checks import InvalidMessage, check_frames

STATES: Dict[int, str] = {
    value: name for name, value in vars(GoalStatus).items() if name.isupper() and value in range(10)
}
GOAL_ACTIONS = ("move_base", "move_base_flex/move_base", "move_base_flex/exe_path")
"""Actions that drive. A relayed goal appears in two of them; the goals of the action with the most are used, since a
client's first goal can be published before a recorder has connected to it."""
SCAN_PERIOD = 0.5
MAP, ODOM = "map", "odom"
"""Frames of REP 105; for a robot in a namespace, odom is prefixed by it."""
OF_ALL = ("tf", "tf_static", MAP)
"""Topics that all robots share, whatever their namespaces."""


class DriveEvents:
    """Turns messages into the events of a drive; `handle` takes them in order, from one thread at a time.

    Args:
        namespace: The robot's namespace, also the prefix of its frames; empty for a single robot.
    """

    def __init__(self, namespace: str = "") -> None:
        self._odom_frame = f"{namespace}/{ODOM}" if namespace else ODOM
        self._base = ""  # the robot's base frame: the first child of odom, base_footprint or base_link
        self._log = DriveLog()
        self._goal_logs = {action: DriveLog() for action in GOAL_ACTIONS}
        self._buffer = tf2_ros.BufferCore(rospy.Duration(30.0))
        self._last_scan = self._now = -np.inf
        self.handlers: Dict[str, Callable[[Any, float], None]] = {
            "map": self._map,
            "tf": self._tf,
            "tf_static": self._tf_static,
            "odom": self._odom,
            "scan": self._scan,
            "cmd_vel": self._command,
            "ground_truth": self._truth,
            "contacts": self._contacts,
            "move_base/recovery_status": self._recovery,
        }
        for action in GOAL_ACTIONS:
            self.handlers[f"{action}/goal"] = partial(self._goal, action)
            self.handlers[f"{action}/result"] = partial(self._result, action)

    def handle(self, topic: str, message: Any, now: float) -> None:
        """Take one message, received at `now` (s).

        Unknown topics, invalid messages and messages of another type than expected are left out. Where the clock was
        set back, the drive starts again with the active goals: one time would have two poses.
        """
        if now < self._now:
            rospy.logwarn("the clock was set back by %.2f s: the report begins again from there", self._now - now)
            self._log = self._log.begun_anew(now)
            self._goal_logs = {action: log.begun_anew(now) for action, log in self._goal_logs.items()}
            self._buffer.clear()  # keeps static transforms
            self._last_scan = -np.inf
        self._now = now
        handler = self.handlers.get(topic.lstrip("/"), self._plan if topic.endswith("/plan") else None)
        if handler is not None:
            try:
                handler(message, now)
            except InvalidMessage:
                pass
            except AttributeError as error:
                rospy.logwarn_once(f"left out {topic}: messages of type {message._type} are not understood: {error}")

    def drive(self) -> Drive:
        """Return the drive so far."""
        drive = self._log.drive()
        drive.goals = self.goals()
        return drive

    def goals(self) -> List[GoalRecord]:
        """Return the goals so far."""
        return max((log.goals for log in self._goal_logs.values()), key=len)

    def _map(self, message: Any, _now: float) -> None:
        self._log.map = conversions.map_from_message(message)

    def _tf(self, message: Any, now: float, static: bool = False) -> None:
        for stamped in sound_transforms(message.transforms):
            parent, child = stamped.header.frame_id, stamped.child_frame_id
            stamp = stamped.header.stamp.to_sec()
            pose = conversions.transform_from_message(stamped.transform)
            # tf2 warns of the message classes that rosbag generates; only the planar part is used.
            planar = TransformStamped(conversions.header(parent, stamp), child, conversions.transform_to_message(pose))
            (self._buffer.set_transform_static if static else self._buffer.set_transform)(planar, "drive")
            if (parent, child) == (MAP, self._odom_frame):
                # amcl dates map -> odom ahead by transform_tolerance; it holds from now on.
                self._log.add_correction(min(stamp, now), pose)
            elif parent == self._odom_frame and not static and child == (self._base or child):
                self._base = child
                self._log.add_odometry(stamp, pose)

    def _tf_static(self, message: Any, now: float) -> None:
        self._tf(message, now, static=True)

    def _odom(self, message: Any, _now: float) -> None:
        self._log.add_velocity(message.header.stamp.to_sec(), conversions.twist_from_message(message.twist.twist))

    def _scan(self, message: Any, now: float) -> None:
        if now - self._last_scan < SCAN_PERIOD:
            return
        map_from_laser = self._lookup(MAP, message.header.frame_id)
        if map_from_laser is not None:
            self._last_scan = now
            scan = conversions.scan_from_message(message)
            self._log.add_seen(map_from_laser.transform_points(scan.hit_points))

    def _command(self, message: Any, now: float) -> None:
        self._log.add_command(now, conversions.twist_from_message(message))

    def _truth(self, message: Any, _now: float) -> None:
        self._log.add_truth(message.header.stamp.to_sec(), conversions.pose_from_message(message.pose.pose))

    def _contacts(self, message: Any, now: float) -> None:
        # The simulator publishes contacts as markers, a type that every system has; `text` names the body.
        for marker in message.markers:
            self._log.add_contact(now, marker.pose.position.x, marker.pose.position.y, marker.text)

    def _recovery(self, message: Any, _now: float) -> None:
        for log in self._goal_logs.values():
            log.add_recovery(message.recovery_behavior_name)

    def _plan(self, message: Any, now: float) -> None:
        path = conversions.path_from_message(message)
        if len(path) and path.frame.lstrip("/") == MAP:
            self._log.add_plan(now, path.poses)

    def _goal(self, action: str, message: Any, now: float) -> None:
        stamped = message.goal.path.poses[-1:] if hasattr(message.goal, "path") else [message.goal.target_pose]
        for pose_stamped in stamped:
            pose = conversions.pose_from_message(pose_stamped.pose)
            frame = pose_stamped.header.frame_id.lstrip("/") or MAP
            map_from_frame = Pose2D(0.0, 0.0, 0.0) if frame == MAP else self._lookup(MAP, frame)
            if map_from_frame is not None:
                self._goal_logs[action].start_goal(now, message.goal_id.id, map_from_frame.compose(pose))

    def _result(self, action: str, message: Any, now: float) -> None:
        state = STATES.get(message.status.status, str(message.status.status))
        self._goal_logs[action].end_goal(now, message.status.goal_id.id, state, message.status.text)

    def _lookup(self, target: str, source: str) -> Optional[Pose2D]:
        try:
            check_frames(source)
            found = self._buffer.lookup_transform_core(target, source.lstrip("/"), rospy.Time(0))
        except (tf2_ros.TransformException, InvalidMessage):
            return None
        return conversions.transform_from_message(found.transform)


def read_bag(path: str, namespace: str = "") -> Tuple[Drive, List[str]]:
    """Return the drive recorded in a bag and the topics it was made of.

    Args:
        path: Path of the bag.
        namespace: The robot's namespace; empty for a single robot.

    Raises:
        OSError: The file cannot be opened.
        ValueError: It is no bag, or a damaged one.
    """
    namespace = namespace.strip("/")
    events = DriveEvents(namespace)
    used = set()
    with open_bag(path) as bag:
        for topic, message, stamp in read_messages(bag):
            own = _own_name(topic, namespace)
            if own in events.handlers or own.endswith("/plan"):
                used.add(topic)
                events.handle(own, message, stamp.to_sec())
    return events.drive(), sorted(used)


def robots_in(path: str) -> List[str]:
    """Return the namespaces of the robots in a bag: those with a topic odom."""
    with open_bag(path) as bag:
        names = [topic.lstrip("/") for topic in bag.get_type_and_topic_info().topics]
    return sorted(name[:-len(f"/{ODOM}")] for name in names if name.endswith(f"/{ODOM}"))


def _own_name(topic: str, namespace: str) -> str:
    """Return a topic's name relative to a robot's namespace; empty for another robot's topic.

    A name without a leading slash was recorded from within the robot's namespace.
    """
    name = topic.lstrip("/")
    if not namespace or name == topic or name in OF_ALL:
        return name
    return name[len(namespace) + 1:] if name.startswith(f"{namespace}/") else ""
