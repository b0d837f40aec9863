"""~current_goal in the global frame, as move_base shows it, without listening to tf all the time.

A goal in another frame is rare, and a Python tf listener costs more than the rest of the relay together. So one is
opened for such a goal alone, and closed again.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Callable

import rospy
from geometry_msgs.msg import Pose, PoseStamped, Quaternion

from mbf_relay.outcomes import TransformError
from mbf_relay.ros.conversions import InvalidMessage, pose_from_message, pose_stamped
from mbf_relay.ros.transforms import Transforms

TF_TIMEOUT = 2.0
"""Wall time (s) to wait for the transform, after which the goal is shown as it came, as move_base does."""


class GoalFrame:
    """Hands goals on in one frame, the newest last."""

    def __init__(self, frame: str, publish: Callable[[PoseStamped], None]) -> None:
        self._frame, self._publish = frame.lstrip("/"), publish
        self._lock = threading.Lock()
        self._newest = 0

    def show(self, pose: PoseStamped) -> None:
        """Hand a goal on: at once where it is in the frame, else as soon as tf knows, unless a newer one came."""
        with self._lock:
            self._newest += 1
            if pose.header.frame_id.lstrip("/") in ("", self._frame):
                self._publish(with_unit_quaternion(pose))
            else:
                threading.Thread(target=self._transform, args=(pose, self._newest), daemon=True).start()

    def _transform(self, pose: PoseStamped, number: int) -> None:
        shown = transformed(pose, self._frame)
        with self._lock:
            if number == self._newest:
                self._publish(shown)


def with_unit_quaternion(pose: PoseStamped) -> PoseStamped:
    """Return a pose whose quaternion has length 1, as it has after move_base's transform; RViz warns of any other."""
    turn = pose.pose.orientation
    length = math.sqrt(turn.x ** 2 + turn.y ** 2 + turn.z ** 2 + turn.w ** 2)
    if length == 0.0 or abs(length - 1.0) < 1e-9:
        return pose
    unit = Quaternion(turn.x / length, turn.y / length, turn.z / length, turn.w / length)
    return PoseStamped(pose.header, Pose(pose.pose.position, unit))


def transformed(pose: PoseStamped, frame: str, timeout: float = TF_TIMEOUT) -> PoseStamped:
    """Return a pose in another frame by the newest transform, or as it is where tf gives none in `timeout` s."""
    transforms, deadline = Transforms(), time.monotonic() + timeout
    try:
        while True:
            try:
                frame_from_pose = transforms.lookup(frame, pose.header.frame_id)
                break
            except TransformError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.02)
        return pose_stamped(frame_from_pose.compose(pose_from_message(pose.pose)), frame, pose.header.stamp)
    except (TransformError, InvalidMessage) as error:
        rospy.logwarn("goal shown in its own frame: %s", error)
        return pose
    finally:
        transforms.close()
