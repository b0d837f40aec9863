"""A costmap that sees by one topic of scans, and frames that all lie in one place."""

from geometry_msgs.msg import TransformStamped

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.costmap import inputs


class StillFrames:
    """Frames that all lie in one place; "map" does not move with the robot."""

    @staticmethod
    def rides_on(_base, frame):
        return frame != "map"

    def lookup_message(self, *_frames):
        message = TransformStamped()
        message.transform.rotation.w = 1.0
        return message

    @staticmethod
    def lookup(*_frames):
        return IDENTITY


def scan_source(frames, patience, **source):
    """Return a costmap of 2 m and the source "scan" that feeds it, whose messages wait so long (s) for frames."""
    costmap = build_costmap("local_costmap", {
        "rolling_window": True, "width": 2.0, "height": 2.0, "plugins": [{"name": "o", "type": "ObstacleLayer"}],
        "o": {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "marking": True, **source}}})
    return costmap, inputs.SensorInput(
        "scan", costmap.sources["scan"], costmap, frames, patience, max_age=1.0,
        timings=LidarTimings(frames, lambda: (costmap.robot_frame, costmap.frame)))
