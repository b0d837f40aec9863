"""Frames: tf lookups as planar poses, with errors that name the stale frame and its age."""

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
"""Messages of /tf that wait to be read until somebody asks for a transform: about a second's."""
CONTENTION_PERIOD = 10.0
"""Seconds between two warnings that more than one node tells of a frame."""
MOST_TROUBLES = 64
"""Frames whose refused transforms are warned of each by itself; a flood of names is warned of as one."""


class CheckedListener:
    """A tf listener that hands tf2 only what it survives: its C++ core ends the process on stamps near 2^32.

    What is ahead of the clock is refused too, or it would stay the newest relation until the clock has caught up.
    Most of what comes is asked for by nobody before the next comes, so it is read in one go when somebody asks: one by
    one takes ten times as long.

    Args:
        buffer: Takes the transforms.
        cache_time: Age (s) beyond which the buffer keeps nothing.
        changed: Called after each message that was taken.
    """

    def __init__(self, buffer: AttentiveBuffer, cache_time: float, changed: Callable[[], None]) -> None:
        self._buffer, self._cache_time, self._changed = buffer, cache_time, changed
        self._tree = FrameTree(self._is_there)
        self._trouble: Dict[str, ThrottledWarnings] = {}  # by child frame; a busy machine's hiccup is worth no warning
        self._refused: Dict[str, str] = {}  # why nothing is taken of a frame, by its name, while that is so
        self._lock = threading.Lock()  # one takes or reads at a time, in the order of coming
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
        """Listen to /tf, where it does not."""
        if self._moving is None:
            self._moving = self._subscribe("/tf", self.take)

    def rest(self) -> None:
        """Listen to /tf_static alone."""
        if self._moving is not None:
            self._moving.unregister()
            self._moving = None

    def close(self) -> None:
        """Stop listening."""
        self.rest()
        if self._static is not None:
            self._static.unregister()

    def take(self, message: Any) -> None:
        """Take a message of /tf."""
        with self._lock:
            self._pending.append((message, self._look_at_clock()))
            if len(self._pending) > MOST_PENDING:
                self._read_pending()
        self._changed()

    def take_static(self, message: Any) -> None:
        """Take a message of /tf_static, whose stamps say nothing."""
        with self._lock:
            self._read(message, self._look_at_clock(), None)
        self._changed()

    def frames_above(self, base: str, frame: str) -> Dict[str, bool]:
        """Return what FrameTree.above does, of all that has come."""
        with self._lock:
            self._read_pending()
            return self._tree.above(base, frame)

    def refusal(self, *frames: str) -> str:
        """Return what to add where no way between two frames is known: nothing, or what was refused on that way."""
        with self._lock:
            on_the_way = [name for frame in frames for name in (frame.lstrip("/"), *self._tree.line(frame))]
            name = next((name for name in on_the_way if name in self._refused), None)
            return "" if name is None else f"; the transform of '{shown(name)}' was refused: {self._refused[name]}"

    def came_at(self, *frames: str) -> float:
        """Return when (s) the last word on /tf came of what moves between two frames, of several the earliest."""
        with self._lock:
            lines = [set(self._tree.line(frame).values()) for frame in frames]
            between = lines[0].symmetric_difference(*lines[1:])
            return min((one.heard_at for one in between if not one.is_fixed), default=-math.inf)

    def attend(self) -> None:
        """Read what has come."""
        if not self._pending:
            return
        with self._lock:
            self._read_pending()

    def _read_pending(self) -> None:
        while self._pending:
            self._read(*self._pending.popleft(), self._cache_time)

    def _look_at_clock(self) -> float:
        """Return ROS time (s); where it was set back, what came before belongs to a world that is over.

        With the lock held: of two threads that look outside of it, the one that goes on last would find time set back.
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
            if self._is_sound(transform, sender, now, max_age):
                if max_age is None:
                    self._tell_of_move(transform, sender)
                    self._buffer.set_transform_static(transform, sender)
                else:
                    self._buffer.set_transform(transform, sender)

    def _is_sound(self, message: TransformStamped, sender: str, now: float, max_age: Optional[float]) -> bool:
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
        """Tell where what is said never to move has moved: whatever is seen from there is elsewhere from now on."""
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
    """Return whether two relations of one frame are the same, whatever their stamps."""
    same_parent = one.header.frame_id.lstrip("/") == other.header.frame_id.lstrip("/")
    return same_parent and bool(one.transform == other.transform)


class Transforms:
    """A tf buffer that gives planar poses.

    Args:
        cache_time: Age (s) beyond which it keeps nothing.
        changed: Called after each message of /tf and /tf_static, in the subscriber's thread.
    """

    def __init__(self, cache_time: float = 10.0, changed: Callable[[], None] = lambda: None) -> None:
        self.buffer = AttentiveBuffer(rospy.Duration(cache_time))
        self._cache_time, self._changed = cache_time, changed
        self._listener: Optional[CheckedListener] = None
        self.listen()

    def listen(self) -> None:
        """Listen, where it does not."""
        if self._listener is None:
            self._listener = CheckedListener(self.buffer, self._cache_time, self._changed)
        self._listener.listen()

    def rest(self) -> None:
        """Listen to /tf_static alone, for whoever needs nothing that moves for now."""
        if self._listener is not None:
            self._listener.rest()

    def close(self) -> None:
        """Stop listening; what is known stays."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def lookup(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None, named: str = "",
    ) -> Pose2D:
        """Return the transform that takes poses in `source_frame` to `target_frame`.

        Args:
            target_frame, source_frame: Frame names, with or without a leading slash.
            stamp: Time (s) to look at; the newest where None.
            timeout: Time (s) to wait for it; call with 0 from callbacks.
            max_age: Age (s) beyond which the newest relation is refused; no limit where None.
            named: The parameter that says so, for the text.

        Raises:
            TransformError: Naming the frames, and the age of the relation where it is too old.
        """
        found = self.lookup_message(target_frame, source_frame, stamp, timeout, max_age, named)
        return transform_from_message(found.transform)

    def lookup_message(
        self, target_frame: str, source_frame: str, stamp: Optional[float] = None, timeout: float = 0.0,
        max_age: Optional[float] = None, named: str = "",
    ) -> TransformStamped:
        """Return the transform as a message, for whoever needs all three dimensions; arguments as for `lookup`."""
        time = _tf2_time(stamp)
        frames = _tf2_frames(target_frame, source_frame)
        try:
            if timeout > 0.0:  # else the look whether it is there would be one more, forty times a second
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
        """Return what FrameTree.above does, of what was heard since listening began."""
        return {} if self._listener is None else self._listener.frames_above(base, frame)

    def rides_on(self, base: str, frame: str) -> bool:
        """Return whether a sensor in `frame` moves with the robot that has `base`.

        It does not where what /tf moves lies between the robot and what both hang on: map, odom, or a place in them.
        """
        return all(self.frames_above(base, frame).values())

    def can_transform(self, target_frame: str, source_frame: str, stamp: Optional[float] = None) -> bool:
        """Return whether the relation is known at `stamp` (s), or at all where None."""
        try:
            return bool(self.buffer.can_transform(
                *_tf2_frames(target_frame, source_frame), _tf2_time(stamp), rospy.Duration(0)))
        except TransformError:
            return False


def _tf2_frames(target: str, source: str) -> Tuple[str, str]:
    """Return the names of two frames as tf2 takes them."""
    try:
        check_frames(target, source)
    except InvalidMessage as error:
        raise TransformError(f"no transform from {shown(source)!r} to {shown(target)!r}: {error}") from error
    return target.lstrip("/"), source.lstrip("/")


def _tf2_time(stamp: Optional[float]) -> rospy.Time:
    """Return a time (s), the newest where None, as tf2 survives it."""
    if stamp is None:
        return rospy.Time(0)
    if not 0.0 <= stamp < TF2_END:
        raise TransformError(f"there is no transform at {stamp:.2f} s, which is no time a clock of ROS shows")
    return rospy.Time.from_sec(stamp)


class TransformPublisher:
    """Sends planar transforms on /tf; one per process, whatever threads use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=100, tcp_nodelay=True)

    def send(self, parent: str, child: str, child_in_parent: Pose2D, stamp: Any) -> None:
        """Publish one transform; `stamp` in seconds or as rospy.Time."""
        self.send_messages([TransformStamped(header(parent, stamp), child, transform_to_message(child_in_parent))])

    def send_messages(self, messages: List[TransformStamped]) -> None:
        """Publish ready messages in one."""
        with self._lock:
            self._publisher.publish(TFMessage(messages))
