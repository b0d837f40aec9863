"""A faster start of nodes: rospy's fixed waits and searches take a good part of it on a small computer."""

from __future__ import annotations

import os
import time
from functools import lru_cache

import rospkg
import rospy.impl.init
from rospy.impl.statistics import SubscriberStatisticsLogger

LOGGING = "ROS_PYTHON_LOG_CONFIG_FILE"
"""Environment variable with the path of rospy's logging configuration."""
FIRST_LOOK = 0.001
"""Wall time (s) of rospy's first sleep while it waits for its registration, which takes a few ms."""

_are_there_statistics = SubscriberStatisticsLogger.is_enabled


class SlowingClock:
    """Replaces the module `time` in code that polls: its sleeps are short at first and become longer."""

    def __init__(self) -> None:
        self._pause = FIRST_LOOK

    def sleep(self, longest: float) -> None:
        """Sleep for twice the time of the last call, up to `longest` (s)."""
        time.sleep(min(self._pause, longest))
        self._pause *= 2.0


def apply_patches() -> None:
    """Apply this module's patches to rospy; before rospy.init_node.

    init_node sleeps 0.1 s for a registration that takes 5 ms, and reads the manifests of all packages to find its
    logging configuration. For each subscription rospy asks the master for the parameter that enables statistics; the
    first answer is used for all.
    """
    rospy.impl.init.time = SlowingClock()
    path = logging_configuration()
    if path:
        os.environ.setdefault(LOGGING, path)
    SubscriberStatisticsLogger.is_enabled = staticmethod(lru_cache(maxsize=None)(_are_there_statistics))


def logging_configuration() -> str:
    """Return the path of rospy's logging configuration, empty where it is in none of the usual places."""
    roots = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    folders = [os.path.join(rospkg.get_ros_home(), "config"), rospkg.get_etc_ros_dir()]
    folders += [os.path.join(root, "rosgraph", "conf") for root in roots if root]
    paths = [os.path.join(folder, f"python_logging.{ending}") for folder in folders for ending in ("conf", "yaml")]
    return next((path for path in paths if os.path.isfile(path)), "")
