"""tf: a listener that validates transforms, lookups as planar poses with errors that name frames and age, a publisher.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Optional, Tuple

import genpy
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import (
    AHEAD,
    TF2_END,
    InvalidMessage,
    check_frames,
    check_stamp,
    shown,
    why_old,
)
from mbf_relay.ros.common.connected_nodes import connected_nodes
from mbf_relay.ros.common.conversions import header, take_transform, transform_from_message, transform_to_message
from mbf_relay.ros.common.frame_tree import ContestedFrame, FrameTree
from mbf_relay.ros.common.tf_buffer import AttentiveBuffer, UnreadTransforms
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings

MOST_PENDING = 50
"""Messages of /tf that may wait to be deserialized: about a second's."""
CONTENTION_PERIOD = 10.0
"""Seconds between two warnings that more than one node publishes a frame."""
MOST_TROUBLES = 64
"""Frames with a warning of their own; refused transforms of further ones share one, lest a flood of names fill memory.
"""


class CheckedListener:
    """A tf listener that passes only valid transforms to tf2, whose C++ core aborts the process on stamps near 2^32.

    Stamps ahead of the clock are refused, too: such a transform would stay the newest until the clock has caught up.
    Messages of /tf are kept as bytes and deserialized all together when a transform is asked for; one by one they take
    ten times as long.

    Args:
        buffer: Gets the transforms.
        cache_time: Age (s) beyond which transforms of /tf are dropped.
        changed: Called after each message received.
    """

    def __init__(self, buffer: AttentiveBuffer, cache_time: float, changed: Callable[[], None]) -> None:
        self._buffer, self._cache_time, self._changed = buffer, cache_time, changed
        self._tree = FrameTree(self._is_there)
        self._trouble: Dict[str, ThrottledWarnings] = {}  # by child frame
        self._refused: Dict[str, str] = {}  # why the last transform of a frame was refused, by child frame
        self._lock = threading.Lock()  # guards all below and the buffer's writing; messages are read in their order
        self._pending: Deque[Tuple[Any, float]] = deque()
        self._heard_at = rospy.get_time()
        buffer.attend = self.attend
        self._static: Optional[rospy.Subscriber] = None
        self._moving: Optional[rospy.Subscriber] = None
        self._static = self._subscribe("/tf_static", self.take_static)
        self.listen()

    def _subscribe(self, topic: str, take: Callable[[Any], None]) -> rospy.Subscriber:
        return rospy.Subscriber(topic, UnreadTransforms, take, buff_size=1 << 20, tcp_nodelay=True)

    def listen(self) -> None:
        """Subscribe to /tf, unless it is."""
        if self._moving is None:
            self._moving = self._subscribe("/tf", self.take)

    def rest(self) -> None:
        """Unsubscribe from /tf; /tf_static goes on."""
        if self._moving is not None:
            self._moving.unregister()
            self._moving = None

    def close(self) -> None:
        """Unsubscribe from both topics."""
        self.rest()
        if self._static is not None:
            self._static.unregister()

    def take(self, message: Any) -> None:
        """Receive a message of /tf."""
        with self._lock:
            self._pending.append((message, self._look_at_clock()))
            if len(self._pending) > MOST_PENDING:
                self._read_pending()
        self._changed()

    def take_static(self, message: Any) -> None:
        """Receive a message of /tf_static, whose stamps are ignored."""
        with self._lock:
            self._read(message, self._look_at_clock(), None)
        self._changed()

    def frames_above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return FrameTree.above of all transforms received."""
        with self._lock:
            self._read_pending()
            return self._tree.above(base, frame)

    def refusal(self, *frames: str) -> str:
        """Return what to add to a lookup's error: which transform on the way between the frames was refused, or empty.
        """
        with self._lock:
            on_the_way = [name for frame in frames for name in (frame.lstrip("/"), *self._tree.line(frame))]
            name = next((name for name in on_the_way if name in self._refused), None)
            return "" if name is None else f"; the transform of '{shown(name)}' was refused: {self._refused[name]}"

    def came_at(self, *frames: str) -> float:
        """Return the ROS time (s) at which the chain between two frames was last received on /tf.

        Of its transforms that are not static the one received longest ago counts; -inf where all are static.
        """
        with self._lock:
            lines = [set(self._tree.line(frame).values()) for frame in frames]
            between = lines[0].symmetric_difference(*lines[1:])
            return min((one.heard_at for one in between if not one.is_fixed), default=-math.inf)

    def attend(self) -> None:
        """Read the messages of /tf that wait."""
        if not self._pending:
            return
        with self._lock:
            self._read_pending()

    def _read_pending(self) -> None:
        while self._pending:
            self._read(*self._pending.popleft(), self._cache_time)

    def _look_at_clock(self) -> float:
        """Return ROS time (s); where it was set back, as by a simulation's reset, forget all transforms of /tf.

        Call with the lock held: of two threads that read the time outside of it, the second to enter could have the
        earlier time and would take that for a reset.
        """
        now: float = rospy.get_time()
        if now < self._heard_at:
            self._pending.clear()
            self._buffer.known.forget()
        self._heard_at = now
        return now

    def _read(self, message: Any, now: float, max_age: Optional[float]) -> None:
        sender = message._connection_header.get("callerid", "")
        try:
            transforms = message.transforms
        except genpy.DeserializationError as error:
            self._warn_of("", f"refused a message of /tf from {sender}: {error}")
            return
        for transform in transforms:
            if self._admit(transform, sender, now, max_age):
                if max_age is None:
                    self._tell_of_move(transform, sender)
                    self._buffer.set_transform_static(transform, sender)
                else:
                    self._buffer.set_transform(transform, sender)

    def _admit(self, message: TransformStamped, sender: str, now: float, max_age: Optional[float]) -> bool:
        """Enter a transform into the tree of frames; return whether it is to be taken, and warn where it is not."""
        parent, child = message.header.frame_id, message.child_frame_id
        try:
            take_transform(message)
            if max_age is not None:
                check_stamp(message.header.stamp.to_sec(), now, max_age)
            elif message.header.stamp.to_sec() >= TF2_END:
                message.header.stamp = rospy.Time()
            bygone = self._tree.add(parent, child, sender, now, is_fixed=max_age is None)
            if bygone:
                self._buffer.known.forget(bygone)
        except ContestedFrame as error:
            known = self._buffer.known.fixed(child)
            if known is None or max_age is not None or not _is_alike(known, message):
                rospy.logwarn_throttle(CONTENTION_PERIOD, f"refused a transform: {error}")
            return False
        except InvalidMessage as error:
            name = child if len(self._trouble) < MOST_TROUBLES else ""
            if name:
                self._refused[name.lstrip("/")] = str(error)
            self._warn_of(name, f"refused a transform from '{shown(parent)}' to '{shown(child)}': {error}")
            return False
        if child in self._trouble:
            self._trouble[child].worked()
            self._refused.pop(child.lstrip("/"), None)
        return True

    def _is_there(self, sender: str, is_fixed: bool) -> bool:
        """Return whether a node still sends on /tf_static, or on /tf."""
        topic = self._static if is_fixed else self._moving
        return is_fixed if topic is None else sender in connected_nodes(topic)

    def _tell_of_move(self, message: TransformStamped, sender: str) -> None:
        """Warn where a new static transform differs from the one before: all data in that frame are moved by it."""
        known = self._buffer.known.fixed(message.child_frame_id)
        if known is not None and not _is_alike(known, message):
            before, after = transform_from_message(known.transform), transform_from_message(message.transform)
            rospy.logwarn(
                "%s has moved '%s' on /tf_static: it was at x %.3f m, y %.3f m, yaw %.3f rad on '%s', and is at x %.3f "
                "m, y %.3f m, yaw %.3f rad on '%s'", sender, message.child_frame_id, *before, known.header.frame_id,
                *after, message.header.frame_id)

    def _warn_of(self, child: str, text: str) -> None:
        self._trouble.setdefault(child, ThrottledWarnings()).say(text)


def _is_alike(one: TransformStamped, other: TransformStamped) -> bool:
    """Return whether two transforms of one child frame are equal but for their stamps."""
    same_parent = one.header.frame_id.lstrip("/") == other.header.frame_id.lstrip("/")
    return same_parent and bool(one.transform == other.transform)


class Transforms:
    """A tf buffer and listener whose lookups give planar poses.

    Args:
        cache_time: Age (s) beyond which transforms of /tf are dropped.
        changed: Called after each message of /tf and /tf_static, in the subscriber's thread.
    """

    def __init__(self, cache_time: float = 10.0, changed: Callable[[], None] = lambda: None) -> None:
        self.buffer = AttentiveBuffer(rospy.Duration(cache_time))
        self._cache_time, self._changed = cache_time, changed
        self._listener: Optional[CheckedListener] = None
        self.listen()

    def listen(self) -> None:
        """Subscribe to /tf and /tf_static, unless it is."""
        if self._listener is None:
            self._listener = CheckedListener(self.buffer, self._cache_time, self._changed)
        self._listener.listen()

    def rest(self) -> None:
        """Unsubscribe from /tf while no moving transform is needed; /tf_static goes on."""
        if self._listener is not None:
            self._listener.rest()

    def close(self) -> None:
        """Unsubscribe from both topics; the buffer stays as it is."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def lookup(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None, named: str = "",
    ) -> Pose2D:
        """Return the pose of `source_frame` in `target_frame`, which takes coordinates from the former to the latter.

        Args:
            target_frame, source_frame: Frame names, with or without a leading slash.
            stamp: ROS time (s) of the transform; the newest where None.
            timeout: Time (s) to wait for it; 0 in callbacks.
            max_age: Largest age (s) of a transform that is not static; no limit where None.
            named: Name of the parameter that sets max_age, for the error.

        Raises:
            TransformError: There is no such transform, or it is too old; the text names frames and age.
        """
        found = self.lookup_message(target_frame, source_frame, stamp, timeout, max_age, named)
        return transform_from_message(found.transform)

    def lookup_message(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None, named: str = "",
    ) -> TransformStamped:
        """Return the transform as a message, in three dimensions; arguments and errors as for `lookup`."""
        time = _tf2_time(stamp)
        frames = _tf2_frames(target_frame, source_frame)
        try:
            if timeout > 0.0:  # without a timeout the lookup alone does
                self.buffer.can_transform(*frames, time, rospy.Duration(timeout))
            message = self.buffer.lookup_transform_core(*frames, time)
        except tf2_ros.TransformException as error:
            raise TransformError(
                f"no transform from '{source_frame}' to '{target_frame}': {' '.join(str(error).split())}"
                + ("" if self._listener is None else self._listener.refusal(*frames))) from error
        age = (rospy.get_rostime() - message.header.stamp).to_sec()
        moves = message.header.stamp.to_sec() > 0.0 and frames[0] != frames[1]
        if max_age is not None and moves and not -AHEAD <= age <= max_age:
            told = f"{age:.2f} s old; at most {max_age:.2f} s allowed" + (f" ({named})" if named else "")
            if age < 0.0:
                told = f"of before time was set back by {-age:.2f} s"
            elif self._listener is not None:
                told += why_old(age, rospy.get_time() - self._listener.came_at(*frames))
            raise TransformError(f"the transform from '{source_frame}' to '{target_frame}' is {told}")
        return message

    def frames_above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return FrameTree.above of all transforms received since it listens."""
        return {} if self._listener is None else self._listener.frames_above(base, frame)

    def rides_on(self, base: str, frame: str) -> bool:
        """Return whether a sensor in `frame` is mounted on the robot with the base frame `base`.

        It is not where the chain from `base` up to the nearest common ancestor (as map or odom) has a moving transform.
        """
        return all(self.frames_above(base, frame).values())

    def can_transform(self, target_frame: str, source_frame: str, stamp: Optional[float] = None) -> bool:
        """Return whether there is a transform at `stamp` (s), or at any time where None."""
        try:
            return bool(self.buffer.can_transform(
                *_tf2_frames(target_frame, source_frame), _tf2_time(stamp), rospy.Duration(0)))
        except TransformError:
            return False


def _tf2_frames(target: str, source: str) -> Tuple[str, str]:
    """Return two valid frame names without leading slashes; raise TransformError for an invalid one."""
    try:
        check_frames(target, source)
    except InvalidMessage as error:
        raise TransformError(f"no transform from {shown(source)!r} to {shown(target)!r}: {error}") from error
    return target.lstrip("/"), source.lstrip("/")


def _tf2_time(stamp: Optional[float]) -> rospy.Time:
    """Return a time (s) as rospy.Time, 0 for the newest where None; raise TransformError where tf2 would abort."""
    if stamp is None:
        return rospy.Time(0)
    if not 0.0 <= stamp < TF2_END:
        raise TransformError(f"there is no transform at {stamp:.2f} s, which is no time a clock of ROS shows")
    return rospy.Time.from_sec(stamp)


class TransformPublisher:
    """Publishes transforms on /tf; one per process, usable from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=100, tcp_nodelay=True)

    def send(self, parent: str, child: str, child_in_parent: Pose2D, stamp: Any) -> None:
        """Publish one transform; `stamp` in seconds or as rospy.Time."""
        self.send_messages([TransformStamped(header(parent, stamp), child, transform_to_message(child_in_parent))])

    def send_messages(self, messages: List[TransformStamped]) -> None:
        """Publish several transforms in one message."""
        with self._lock:
            self._publisher.publish(TFMessage(messages))
