"""The topics that RViz files and dashboards for move_base listen to, fetched from the server while somebody listens."""

from __future__ import annotations

import threading
from typing import Any, Callable, List, NamedTuple, Optional

import rospy
from geometry_msgs.msg import PolygonStamped, PoseStamped
from map_msgs.msg import OccupancyGridUpdate
from mbf_msgs.msg import RecoveryActionGoal
from move_base_msgs.msg import RecoveryStatus
from nav_msgs.msg import OccupancyGrid, Path
from sensor_msgs.msg import PointCloud2

from mbf_relay.ros.common.unread import unread
from mbf_relay.ros.relay.reconfigure import server_plugins

PLANNER, CONTROLLER = "planners", "controllers"


class Passed(NamedTuple):
    """One topic of move_base's.

    Attributes:
        name: Below the node move_base.
        message: Its type.
        plugin: Kind of the plugin whose topic it is at the server, where the server's name for it takes the place of
            the first part of `name`; empty for the server's own topics.
    """

    name: str
    message: Any
    plugin: str = ""


PASSED = (
    Passed("global_costmap/costmap", OccupancyGrid),
    Passed("global_costmap/costmap_updates", OccupancyGridUpdate),
    Passed("global_costmap/footprint", PolygonStamped),
    Passed("local_costmap/costmap", OccupancyGrid),
    Passed("local_costmap/costmap_updates", OccupancyGridUpdate),
    Passed("local_costmap/footprint", PolygonStamped),
    Passed("NavfnROS/plan", Path, PLANNER),
    Passed("NavfnROS/potential", PointCloud2, PLANNER),
    Passed("GlobalPlanner/plan", Path, PLANNER),
    Passed("GlobalPlanner/potential", OccupancyGrid, PLANNER),
    Passed("DWAPlannerROS/global_plan", Path, CONTROLLER),
    Passed("DWAPlannerROS/local_plan", Path, CONTROLLER),
    Passed("DWAPlannerROS/cost_cloud", PointCloud2, CONTROLLER),
    Passed("DWAPlannerROS/trajectory_cloud", PointCloud2, CONTROLLER),
    Passed("TrajectoryPlannerROS/global_plan", Path, CONTROLLER),
    Passed("TrajectoryPlannerROS/local_plan", Path, CONTROLLER),
    Passed("TrajectoryPlannerROS/cost_cloud", PointCloud2, CONTROLLER),
)


class LazyTopic(rospy.SubscribeListener):
    """A topic passed on, as bytes, while somebody listens.

    Each new listener makes a new subscription, because that is what a server sends a whole costmap for. `_lock` stands
    between the threads in which listeners come and go.
    """

    def __init__(self, name: str, message: Any, source: Callable[[], str]) -> None:
        """Advertise.

        Args:
            name: The topic to offer.
            message: Its type.
            source: Gives the topic to fetch from, asked each time the first listener comes.
        """
        self._unread, self._source = unread(message), source
        self._lock = threading.Lock()
        self._subscriber: Optional[rospy.Subscriber] = None
        self._publisher = rospy.Publisher(name, self._unread, subscriber_listener=self, queue_size=5, tcp_nodelay=True)

    def peer_subscribe(self, _name: str, _publish: Any, _peer_publish: Any) -> None:
        """Fetch, from now on or anew."""
        with self._lock:
            self._leave()
            self._subscriber = rospy.Subscriber(
                self._source(), self._unread, lambda message: self._publisher.publish(message),
                buff_size=1 << 22, tcp_nodelay=True,
            )

    def peer_unsubscribe(self, _name: str, listeners: int) -> None:
        """Stop fetching, if that was the last listener."""
        with self._lock:
            if listeners == 0:
                self._leave()

    def _leave(self) -> None:
        if self._subscriber is not None:
            self._subscriber.unregister()
            self._subscriber = None


def pass_through(server: str, plugin_name: Callable[[str, str], str]) -> List[LazyTopic]:
    """Offer move_base's topics.

    Args:
        server: Name of the server's node.
        plugin_name: Gives the server's name for the plugin of a kind that move_base calls so.
    """

    def source(passed: Passed) -> Callable[[], str]:
        first, rest = passed.name.split("/", 1)
        return lambda: f"{server}/{plugin_name(passed.plugin, first) if passed.plugin else first}/{rest}"

    return [LazyTopic(f"~{passed.name}", passed.message, source(passed)) for passed in PASSED]


class RecoveryTopic(rospy.SubscribeListener):
    """move_base/recovery_status, only while somebody listens.

    This package's server tells of its recoveries; the C++ server sends goals to its own recovery action, which tell
    less.
    """

    def __init__(self, server: str, where: Callable[[], PoseStamped]) -> None:
        """Advertise.

        Args:
            server: Name of the server's node.
            where: Gives the robot's pose, as the server last told it.
        """
        self._server, self._where = server, where
        self._lock = threading.Lock()
        self._subscribers: List[rospy.Subscriber] = []
        self._publisher = rospy.Publisher(
            "move_base/recovery_status", RecoveryStatus, subscriber_listener=self, queue_size=10)

    def peer_subscribe(self, _name: str, _publish: Any, _peer_publish: Any) -> None:
        """Listen to the server's recoveries."""
        with self._lock:
            if not self._subscribers:
                self._subscribers = [
                    rospy.Subscriber(f"{self._server}/recovery_status", RecoveryStatus, self._publisher.publish),
                    rospy.Subscriber(f"{self._server}/recovery/goal", RecoveryActionGoal, self._take),
                ]

    def peer_unsubscribe(self, _name: str, listeners: int) -> None:
        """Stop listening, if nobody does here."""
        with self._lock:
            if listeners == 0:
                for subscriber in self._subscribers:
                    subscriber.unregister()
                self._subscribers = []

    def _take(self, message: RecoveryActionGoal) -> None:
        names = [plugin["name"] for plugin in server_plugins(self._server, "recovery_behaviors")]
        behavior = message.goal.behavior
        self._publisher.publish(RecoveryStatus(
            pose_stamped=self._where(), recovery_behavior_name=behavior, total_number_of_recoveries=len(names),
            current_recovery_number=names.index(behavior) if behavior in names else 0,
        ))
