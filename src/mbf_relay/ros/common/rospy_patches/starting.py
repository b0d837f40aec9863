"""What rospy takes its time for while a node starts, done sooner: on a small computer that is a good part of it."""

from __future__ import annotations

import os
import time
from functools import lru_cache

import rospkg
import rospy.impl.init
from rospy.impl.statistics import SubscriberStatisticsLogger

LOGGING = "ROS_PYTHON_LOG_CONFIG_FILE"
"""Environment variable: the file that rospy configures Python's logging by."""
FIRST_LOOK = 0.001
"""Wall time (s) until rospy first looks whether the master has answered; it has after a few ms."""

_are_there_statistics = SubscriberStatisticsLogger.is_enabled


class SlowingClock:
    """Stands in for the module `time` where somebody looks again and again: soon at first, ever less often."""

    def __init__(self) -> None:
        self._pause = FIRST_LOOK

    def sleep(self, longest: float) -> None:
        """Sleep for twice the time of the last call, up to `longest` (s)."""
        time.sleep(min(self._pause, longest))
        self._pause *= 2.0


def start_soon() -> None:
    """Prepare rospy.init_node, which waits 0.1 s for what is there after 5 ms, and reads the manifests of all packages.

    For each subscription rospy asks the master whether to keep statistics; the first answer holds for all.
    """
    rospy.impl.init.time = SlowingClock()
    path = logging_configuration()
    if path:
        os.environ.setdefault(LOGGING, path)
    SubscriberStatisticsLogger.is_enabled = staticmethod(lru_cache(maxsize=None)(_are_there_statistics))


def logging_configuration() -> str:
    """Return the file rospy would find by looking through all packages for rosgraph; empty where it must look."""
    roots = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    folders = [os.path.join(rospkg.get_ros_home(), "config"), rospkg.get_etc_ros_dir()]
    folders += [os.path.join(root, "rosgraph", "conf") for root in roots if root]
    paths = [os.path.join(folder, f"python_logging.{ending}") for folder in folders for ending in ("conf", "yaml")]
    return next((path for path in paths if os.path.isfile(path)), "")
