"""Execution of a browser's requests in ROS: goals, cancels, poses, velocities, services."""

from __future__ import annotations

import threading
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Dict, Hashable, Iterable, Optional, Set

import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Twist, Vector3
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseGoal
from std_srvs.srv import Empty
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.ros.common.conversions import header, pose_stamped, pose_to_message, twist_to_message
from mbf_relay.ros.web.readers import SET_DOWN
from mbf_relay.view.dead_man import DeadMan
from mbf_relay.view.wishes import Refused

COMMAND_PERIOD = 0.05
"""Wall time (s) between two velocities while the joystick is held."""
SERVICE_PATIENCE = 2.0
"""Wall time (s) to wait for a service to be advertised."""
ACTIONS = ("move_base", *(
    f"{node}/{action}" for node in ("move_base_flex", "move_base") for action in ("move_base", "exe_path", "recovery")))
"""Actions that may drive the robot: move_base's, and those of a Move Base Flex server."""


class Hands:
    """Publishers and services of one robot.

    Goals and poses have stamp 0, for the newest transform: they hold now, also where two computers' clocks differ.
    `open` and `close` call the ROS master and may block; all else is called from the event loop's thread. Velocities
    are sent by another thread, so that the dead man's switch works however busy the event loop is; `_lock` guards the
    dead man's switch between the two.

    Args:
        namespace: The robot's namespace, with a slash at both ends.
        map_frame: Frame of goals and poses.
        told: Called from any thread with a text on the result of a service call.
    """

    def __init__(self, namespace: str, map_frame: str, told: Callable[[str], None]) -> None:
        self._namespace, self._map_frame, self._told = namespace, map_frame, told
        self._publishers: Dict[str, rospy.Publisher] = {}
        self._services = ThreadPoolExecutor(2, thread_name_prefix="web service")
        self._busy: Dict[str, Any] = {}
        self._set_down: Set[int] = set()  # marker ids of obstacles
        self._lock = threading.Lock()
        self._dead_man = DeadMan()
        self._driving: Optional[threading.Thread] = None

    def open(self) -> None:
        """Advertise all topics."""
        for name, kind in (
            ("move_base/goal", MoveBaseActionGoal),
            ("move_base_simple/goal", PoseStamped),
            ("initialpose", PoseWithCovarianceStamped),
            ("cmd_vel", Twist),
            ("simulator/set_obstacles", MarkerArray),
            *((f"{action}/cancel", GoalID) for action in ACTIONS),
        ):
            self._publishers[name] = rospy.Publisher(f"{self._namespace}{name}", kind, queue_size=10, tcp_nodelay=True)

    def close(self) -> None:
        """Stop the robot if it is driven by hand and unadvertise all topics; it cannot be opened again."""
        self.let_go(self.holder)
        publishers, self._publishers = self._publishers, {}
        for publisher in publishers.values():
            publisher.unregister()
        self._services.shutdown(wait=False)

    def goal(self, pose: Pose2D, has_action: bool) -> str:
        """Send a goal; return its id, or an empty text where move_base takes goals only from move_base_simple/goal.

        Args:
            pose: Goal in the map frame.
            has_action: Whether move_base is known to have the action: a subscriber of its goal may be just a recorder.

        Raises:
            Refused: No node subscribes to goals.
        """
        message = pose_stamped(pose, self._map_frame, rospy.Time())
        action, topic = self._publishers.get("move_base/goal"), self._publishers.get("move_base_simple/goal")
        by_topic = topic is not None and topic.get_num_connections()
        if action is not None and action.get_num_connections() and (has_action or not by_topic):
            goal_id = f"{rospy.get_name()}-{uuid.uuid4().hex[:12]}"
            action.publish(MoveBaseActionGoal(header("", rospy.Time()), GoalID(id=goal_id), MoveBaseGoal(message)))
            return goal_id
        if topic is not None and by_topic:
            topic.publish(message)
            return ""
        raise Refused(f"nobody takes goals: no node listens to {self._namespace}move_base/goal")

    def cancel(self) -> None:
        """Cancel all goals of all clients; raise Refused where no node subscribes to cancels."""
        found = [self._publishers.get(f"{action}/cancel") for action in ACTIONS]
        heard = [publisher for publisher in found if publisher is not None and publisher.get_num_connections()]
        if not heard:
            raise Refused(f"nobody takes goals: no node listens to {self._namespace}move_base/cancel")
        for publisher in heard:
            publisher.publish(GoalID())

    def estimate(self, pose: Pose2D, spread: float, turn_spread: float) -> None:
        """Publish the robot's pose on initialpose.

        Args:
            pose: Pose in the map frame.
            spread: Standard deviation of x and of y (m).
            turn_spread: Standard deviation of the heading (rad).
        """
        message = PoseWithCovarianceStamped(header=header(self._map_frame, rospy.Time()))
        message.pose.pose = pose_to_message(pose)
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = spread ** 2
        covariance[35] = turn_spread ** 2
        message.pose.covariance = covariance
        self._publish("initialpose", message)

    def set_obstacle(self, x: float, y: float, size: float) -> None:
        """Add a box to the simulated world, its centre at (x, y) (m) in the map frame, `size` (m) wide."""
        number = uuid.uuid4().int % 2 ** 31  # random, so that it replaces none of another browser or an earlier run
        self._set_down.add(number)
        box = Marker(header=header(self._map_frame, rospy.Time()), ns=SET_DOWN, id=number, type=Marker.CUBE)
        box.pose = pose_to_message(Pose2D(x, y, 0.0))
        box.pose.position = Point(x, y, 0.25)
        box.scale = Vector3(size, size, 0.5)
        box.color.r, box.color.g, box.color.b, box.color.a = 0.85, 0.45, 0.1, 1.0
        self._publish("simulator/set_obstacles", MarkerArray([box]))

    def remove_obstacles(self, standing: Iterable[int]) -> None:
        """Remove all boxes that browsers added: those of this object, and the marker ids the simulator reports."""
        numbers, self._set_down = self._set_down.union(standing), set()
        markers = [Marker(ns=SET_DOWN, id=number, action=Marker.DELETE) for number in sorted(numbers)]
        self._publish("simulator/set_obstacles", MarkerArray(markers))

    def clear_costmaps(self) -> None:
        """Call move_base/clear_costmaps."""
        self._call("move_base/clear_costmaps", "the costmaps are cleared")

    def reset_world(self) -> None:
        """Call simulator/reset."""
        self._call("simulator/reset", "the simulated world begins anew")

    # --- velocities ---

    @property
    def holder(self) -> Optional[Hashable]:
        """The browser that drives by hand, None for none."""
        with self._lock:
            return self._dead_man.holder

    def push(self, who: Hashable, velocity: Twist2D) -> None:
        """Drive as long as this call is repeated; raise Refused if another browser drives or no node takes cmd_vel."""
        if "cmd_vel" not in self._publishers or not self._publishers["cmd_vel"].get_num_connections():
            raise Refused(f"nobody listens to {self._namespace}cmd_vel")
        with self._lock:
            if not self._dead_man.push(who, velocity, time.monotonic()):
                raise Refused("another browser is driving")
            if self._driving is None:
                self._driving = threading.Thread(target=self._drive, name="web stick", daemon=True)
                self._driving.start()

    def let_go(self, who: Optional[Hashable]) -> None:
        """Stop the robot if this browser drives it by hand."""
        with self._lock:
            stop = self._dead_man.release(who) if who is not None else None
            if stop is not None:  # under the lock, so that no velocity follows it
                self._send(stop)

    def _drive(self) -> None:
        """Send the velocity until no browser drives any more; a zero velocity is sent last."""
        while True:
            with self._lock:
                velocity = self._dead_man.command(time.monotonic())
                if velocity is None:
                    self._driving = None
                    return
                self._send(velocity)
            time.sleep(COMMAND_PERIOD)

    def _send(self, velocity: Twist2D) -> None:
        publisher = self._publishers.get("cmd_vel")
        if publisher is not None:
            publisher.publish(twist_to_message(velocity))

    # --- helpers ---

    def _publish(self, name: str, message: Any) -> None:
        publisher = self._publishers.get(name)
        if publisher is None or not publisher.get_num_connections():
            raise Refused(f"nobody listens to {self._namespace}{name}")
        publisher.publish(message)

    def _call(self, name: str, words: str) -> None:
        """Call a std_srvs/Empty service in another thread; tell `words`, or the error."""
        if name in self._busy and not self._busy[name].done():
            raise Refused(f"{self._namespace}{name} is still being called")

        def call() -> None:
            service = f"{self._namespace}{name}"
            try:
                rospy.wait_for_service(service, SERVICE_PATIENCE)
                rospy.ServiceProxy(service, Empty)()
                self._told(words)
            except (rospy.ROSException, rospy.ServiceException, OSError) as error:
                self._told(f"{service}: {error}")

        self._busy[name] = self._services.submit(call)
