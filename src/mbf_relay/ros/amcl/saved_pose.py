"""The pose saved on the parameter server, with odometry's pose, for an amcl that is restarted."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np
import rospy

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.kept_pose import SAVED_ODOM, KeptPose, kept_pose_from
from mbf_relay.localization.node_parameters import INITIAL, initial_pose_as_parameters, initial_pose_from
from mbf_relay.ros.common import parameters
from mbf_relay.ros.common.impatient_proxy import NO_ANSWER

SavedStart = Tuple[Pose2D, np.ndarray, Optional[KeptPose]]
"""The pose to start at, its covariance, shape (3, 3), and the KeptPose if a previous amcl has saved that pose."""


class SavedPose:
    """Reads and writes `~initial_pose_*`, `~initial_cov_*` and `~saved_odom`.

    While the node runs, a thread of its own writes. In the main thread, an interrupt during a call to the master would
    run the shutdown hooks within it, whose own call would wait for ever for a lock that rospy holds during calls.
    """

    def __init__(self) -> None:
        self._saved_at = -math.inf
        self._newest: Deque[Tuple[KeptPose, np.ndarray]] = deque(maxlen=1)  # until it is written
        self._there = threading.Event()
        threading.Thread(target=self._work, name="saved_pose", daemon=True).start()

    @staticmethod
    def load() -> SavedStart:
        """Return where to start, by the parameters; warn of values that are no finite numbers."""
        values = parameters.read_namespace("~")
        pose, covariance, refused = initial_pose_from(values)
        for name in refused:
            rospy.logwarn("parameter ~%s is no finite number and is ignored; %s is used", name, INITIAL[name])
        return pose, covariance, kept_pose_from(values.get(SAVED_ODOM), pose)

    def take_turn(self, now: float, rate: float) -> bool:
        """Note `now` (s, ROS time) as that of a save if one is due, by a rate in Hz; return whether it is.

        With a rate of 0 or below, none ever is.
        """
        if rate <= 0.0 or 0.0 <= now - self._saved_at < 1.0 / rate:
            return False
        self._saved_at = now
        return True

    def save_soon(self, kept: KeptPose, covariance: np.ndarray) -> None:
        """Have the thread save a pose and its covariance, shape (3, 3); it replaces one that is not written yet."""
        self._newest.append((kept, covariance))
        self._there.set()

    def _work(self) -> None:
        while True:
            self._there.wait()
            self._there.clear()
            if self._newest:
                self.save(*self._newest.pop())

    @staticmethod
    def save(kept: KeptPose, covariance: np.ndarray) -> None:
        """Write a pose and its covariance, shape (3, 3), now; failures are only logged at debug level."""
        try:
            for name, value in initial_pose_as_parameters(kept.pose, covariance).items():
                rospy.set_param(f"~{name}", value)
            rospy.set_param(f"~{SAVED_ODOM}", kept.as_parameters())
        except (*NO_ANSWER, rospy.ROSException) as error:
            rospy.logdebug("the pose could not be saved: %s", error)
