"""move_base's topics, as used by RViz files and dashboards; passed on from the server while they have subscribers."""

from __future__ import annotations

import abc
import threading
from typing import Any, Callable, List, NamedTuple

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
    """One topic of move_base.

    Attributes:
        name: Its name in move_base's private namespace.
        message: Its message class.
        plugin: PLANNER or CONTROLLER for a plugin's topic; the first part of `name` is then replaced by the plugin's
            name at the server. Empty for the server's own topics.
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


class PassedTopic(rospy.SubscribeListener, abc.ABC):
    """A topic that is fed from others while it has subscribers.

    `_lock` guards its subscriptions against rospy's threads.

    Attributes:
        renewed: Whether it subscribes anew for each new subscriber.
    """

    renewed = False

    def __init__(self, name: str, message: Any, **options: Any) -> None:
        """Advertise a topic, by its name and message class; options are rospy.Publisher's."""
        self._lock = threading.Lock()
        self._subscribers: List[rospy.Subscriber] = []
        with self._lock:  # who listened to a relay that has died may connect before it is there
            self._publisher = rospy.Publisher(name, message, subscriber_listener=self, **options)

    @abc.abstractmethod
    def _listen(self) -> List[rospy.Subscriber]:
        """Subscribe to what feeds it."""

    def peer_subscribe(self, _name: str, _publish: Any, _peer_publish: Any) -> None:
        """Subscribe to what feeds it, or subscribe anew."""
        with self._lock:
            if self.renewed or not self._subscribers:
                self._leave()
                self._subscribers = self._listen()

    def peer_unsubscribe(self, _name: str, _listeners: int) -> None:
        """Unsubscribe if that was the last subscriber, by their number now: another may have come."""
        with self._lock:
            if self._publisher.get_num_connections() == 0:
                self._leave()

    def _leave(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._subscribers = []


class LazyTopic(PassedTopic):
    """A topic that is passed on without deserializing it.

    It subscribes anew for each new subscriber, since servers send the whole costmap to new subscribers only; not to a
    costmap's changes, one of which would be lost to those who listen already.
    """

    def __init__(self, name: str, message: Any, source: Callable[[], str]) -> None:
        """Advertise.

        Args:
            name: Name of the topic to publish.
            message: Its message class.
            source: Returns the name of the topic to subscribe to; called for each new subscriber.
        """
        self._unread, self._source = unread(message), source
        self.renewed = message is not OccupancyGridUpdate
        super().__init__(name, self._unread, queue_size=5, tcp_nodelay=True)

    def _listen(self) -> List[rospy.Subscriber]:
        return [rospy.Subscriber(
            self._source(), self._unread, self._publisher.publish, buff_size=1 << 22, tcp_nodelay=True)]


def pass_through(server: str, plugin_name: Callable[[str, str], str]) -> List[LazyTopic]:
    """Offer move_base's topics.

    Args:
        server: Name of the server's node.
        plugin_name: Returns the server's name of a plugin, given its kind and move_base's name.
    """

    def source(passed: Passed) -> Callable[[], str]:
        first, rest = passed.name.split("/", 1)
        return lambda: f"{server}/{plugin_name(passed.plugin, first) if passed.plugin else first}/{rest}"

    return [LazyTopic(f"~{passed.name}", passed.message, source(passed)) for passed in PASSED]


class RecoveryTopic(PassedTopic):
    """move_base/recovery_status.

    This package's server publishes recovery_status itself. The C++ server sends goals to its own recovery action, from
    which the behaviour's name and index are taken.
    """

    def __init__(self, server: str, where: Callable[[], PoseStamped]) -> None:
        """Advertise.

        Args:
            server: Name of the server's node.
            where: Returns the robot's pose from the server's last feedback.
        """
        self._server, self._where = server, where
        super().__init__(f"{rospy.resolve_name('move_base')}/recovery_status", RecoveryStatus, queue_size=10)

    def _listen(self) -> List[rospy.Subscriber]:
        return [
            rospy.Subscriber(f"{self._server}/recovery_status", RecoveryStatus, self._publisher.publish),
            rospy.Subscriber(f"{self._server}/recovery/goal", RecoveryActionGoal, self._take),
        ]

    def _take(self, message: RecoveryActionGoal) -> None:
        names = [plugin["name"] for plugin in server_plugins(self._server, "recovery_behaviors")]
        behavior = message.goal.behavior
        self._publisher.publish(RecoveryStatus(
            pose_stamped=self._where(), recovery_behavior_name=behavior, total_number_of_recoveries=len(names),
            current_recovery_number=names.index(behavior) if behavior in names else 0,
        ))
