"""The topics of each layer of the page."""

from __future__ import annotations

import re
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Tuple

from actionlib_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseArray, PoseStamped
from mbf_msgs.msg import MoveBaseActionResult as FlexActionResult
from move_base_msgs.msg import MoveBaseActionFeedback, MoveBaseActionResult, RecoveryStatus
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan, PointCloud2
from visualization_msgs.msg import MarkerArray

from mbf_relay.ros.common.quick_grids import QuickGrid, QuickGridUpdate


class Source(NamedTuple):
    """Topics of a layer, or of the page's status texts.

    Attributes:
        message: Type of the messages.
        topics: Regular expressions in order of preference, in the robot's namespace unless they begin with a slash.
            All published topics that match the first expression with any match are subscribed to.
        layer: Layer for which it is subscribed to; empty for always, while any browser shows the robot.
        every: Whether every message is used, instead of only the newest.
        period: Least time (s) between two messages that are deserialized.
    """

    message: Any
    topics: Tuple[str, ...]
    layer: str = ""
    every: bool = False
    period: float = 0.0


def _costmap(name: str, topic: str, message: Any, every: bool = False) -> Source:
    return Source(message, (f"move_base_flex/{name}/{topic}", f"move_base/{name}/{topic}"), name, every)


SOURCES: Dict[str, Source] = {
    "map": Source(QuickGrid, ("map", "/map"), "map"),
    "global_costmap": _costmap("global_costmap", "costmap", QuickGrid, every=True),
    "global_costmap_updates": _costmap("global_costmap", "costmap_updates", QuickGridUpdate, every=True),
    "local_costmap": _costmap("local_costmap", "costmap", QuickGrid, every=True),
    "local_costmap_updates": _costmap("local_costmap", "costmap_updates", QuickGridUpdate, every=True),
    "footprint": Source(
        PolygonStamped,
        ("move_base_flex/local_costmap/footprint", "move_base/local_costmap/footprint"),
        "footprint",
        period=0.2,
    ),
    "obstacles": Source(MarkerArray, ("simulator/obstacles",)),  # needed to remove obstacles even if they are not shown
    "scan": Source(LaserScan, ("scan",), "scan"),
    "particles": Source(PoseArray, ("particlecloud",), "particles"),
    "global_plan": Source(Path, (r"move_base_flex/[^/]+/plan", r"move_base/[^/]+/plan")),
    "local_plan": Source(
        Path, (r"move_base_flex/[^/]+/local_plan", r"move_base/[^/]+/local_plan"), "local_plan", period=0.2
    ),
    "trajectories": Source(
        PointCloud2, (r"move_base_flex/[^/]+/trajectory_cloud", r"move_base/[^/]+/trajectory_cloud"), "trajectories"
    ),
    "odometry": Source(Odometry, ("odom",), period=0.1),
    "truth": Source(Odometry, ("ground_truth",), period=0.2),
    "status": Source(GoalStatusArray, ("move_base/status",)),
    "result": Source(MoveBaseActionResult, ("move_base/result",), every=True),
    "outcome": Source(FlexActionResult, ("move_base/navigation_outcome",), every=True),
    "goal": Source(PoseStamped, ("move_base/current_goal",)),
    "feedback": Source(MoveBaseActionFeedback, ("move_base/feedback",), period=0.5),
    "recovery": Source(RecoveryStatus, ("move_base_flex/recovery_status", "move_base/recovery_status"), every=True),
    "diagnostics": Source(DiagnosticArray, ("/diagnostics",), every=True),
    "log": Source(Log, ("/rosout_agg", "/rosout"), "log", every=True),
}


def topics_of(source: Source, namespace: str, published: Mapping[str, str]) -> List[str]:
    """Return the topics to subscribe to.

    Args:
        source: The source.
        namespace: The robot's namespace, with a slash at both ends.
        published: Message types of all published topics, by topic.
    """
    for pattern in source.topics:
        whole = re.compile(pattern if pattern.startswith("/") else re.escape(namespace) + pattern)
        found = [topic for topic, kind in published.items() if kind == source.message._type and whole.fullmatch(topic)]
        if found:
            return sorted(found)
    return []


def robots_of(topics: Iterable[str]) -> List[str]:
    """Return the namespaces, with a slash at both ends, of robots: those with move_base's status, odom or scan."""
    found = set()
    for topic in topics:
        match = re.fullmatch(r"(/(?:.*/)?)(?:move_base/status|move_base_flex/move_base/status|odom|scan)", topic)
        if match and not match.group(1).endswith("/move_base_flex/"):
            found.add(match.group(1))
    return sorted(found)
