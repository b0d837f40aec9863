"""Tests of the ROS edge that need messages but no master; left out where there is no ROS."""

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

collect_ignore_glob = []
try:
    import mbf_msgs.msg  # noqa: F401
    import rospy  # noqa: F401
except ImportError:
    collect_ignore_glob = ["*"]
