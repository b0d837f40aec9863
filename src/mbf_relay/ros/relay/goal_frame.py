"""~current_goal in the global frame, as in move_base, without a permanent tf listener.

Goals in other frames are rare, and a Python tf listener takes more CPU than the rest of the relay. A listener is opened
only for such a goal, in a thread that transforms the newest goal and then ends.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import Callable, Optional

import rospy
from geometry_msgs.msg import Pose, PoseStamped, Quaternion

from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.conversions import pose_from_message, pose_stamped
from mbf_relay.ros.common.transforms import Transforms

TF_TIMEOUT = 2.0
"""Wall time (s) to wait for the transform; after that the goal is published unchanged, as in move_base."""
LOOK_PERIOD = 0.02
"""Wall time (s) between two lookups."""


class GoalFrame:
    """Publishes goals transformed to one frame; an older goal never follows a newer one."""

    def __init__(
        self, frame: str, publish: Callable[[PoseStamped], None], open_transforms: Callable[[], Transforms] = Transforms
    ) -> None:
        """Begin without a goal.

        Args:
            frame: Frame to transform goals to.
            publish: Called with each transformed goal.
            open_transforms: Opens a tf listener.
        """
        self._frame, self._publish, self._open_transforms = frame.lstrip("/"), publish, open_transforms
        self._lock = threading.Lock()  # guards what follows
        self._newest: Optional[PoseStamped] = None
        self._taken_at = 0.0
        self._thread: Optional[threading.Thread] = None

    def show(self, pose: PoseStamped) -> None:
        """Publish a goal: at once if it is in the frame, else when the transform is there, unless a newer one comes."""
        with self._lock:
            if pose.header.frame_id.lstrip("/") in ("", self._frame):
                self._newest = None
                self._publish(with_unit_quaternion(pose))
                return
            self._newest, self._taken_at = pose, time.monotonic()
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="goal to the global frame", daemon=True)
                self._thread.start()

    def _work(self) -> None:
        try:
            with contextlib.closing(self._open_transforms()) as transforms:
                while self._look(transforms):
                    time.sleep(LOOK_PERIOD)
        except Exception as error:  # usually no thread or file descriptor is left
            with self._lock:
                self._thread, pose = None, self._newest
                if pose is not None:
                    self._show_as_it_came(pose, f"{type(error).__name__}: {error}")

    def _look(self, transforms: Transforms) -> bool:
        """Publish the newest goal if its transform is there or TF_TIMEOUT is over; return whether to go on waiting."""
        with self._lock:
            pose = self._newest
            if pose is not None:
                try:
                    shown = transformed(pose, self._frame, transforms)
                except (TransformError, InvalidMessage) as error:
                    if time.monotonic() - self._taken_at < TF_TIMEOUT and not rospy.is_shutdown():
                        return True
                    self._show_as_it_came(pose, str(error))
                else:
                    self._newest = None
                    self._publish(shown)
            self._thread = None
            return False

    def _show_as_it_came(self, pose: PoseStamped, why: str) -> None:
        rospy.logwarn("~current_goal is shown in the goal's own frame: %s", why)
        self._newest = None
        self._publish(pose)


def transformed(pose: PoseStamped, frame: str, transforms: Transforms) -> PoseStamped:
    """Return a pose in another frame by the newest transform; raise TransformError where there is none."""
    frame_from_pose = transforms.lookup(frame, pose.header.frame_id)
    return pose_stamped(frame_from_pose.compose(pose_from_message(pose.pose)), frame, pose.header.stamp)


def with_unit_quaternion(pose: PoseStamped) -> PoseStamped:
    """Return a pose whose quaternion has length 1, as it has after move_base's transform; RViz warns of any other."""
    turn = pose.pose.orientation
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if length == 0.0 or not math.isfinite(length) or abs(length - 1.0) < 1e-9:
        return pose
    unit = Quaternion(turn.x / length, turn.y / length, turn.z / length, turn.w / length)
    return PoseStamped(pose.header, Pose(pose.pose.position, unit))
