"""Several simulators in one graph: one makes the clock, the others keep to it, and each robot sees the others.

Each simulator has physics of its own; the others' robots stand in it as obstacles that are where their owner says.
"""

from __future__ import annotations

import threading
from typing import Any, Callable, Dict, List, Tuple

import rospy
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

PERIOD = 0.1
"""Seconds between two looks at a neighbour; it drives 22 mm meanwhile."""


class ClockFollower:
    """Paces a simulation by another node's /clock; stands in for `pacing.RealTimePacer`.

    Args:
        now: The simulation's time (s).
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._condition = threading.Condition()  # guards the time below
        self._clock = 0.0
        rospy.Subscriber("/clock", Clock, self._take, queue_size=1, tcp_nodelay=True)

    def restart(self) -> None:
        """Begin anew after a pause: what was missed is made up for, as the clock went on."""

    def pace(self, _simulated: float) -> None:
        """Wait until the clock is past the simulation, or ROS goes down."""
        with self._condition:
            while self._clock < self._now() and not rospy.is_shutdown():
                self._condition.wait(0.2)

    def _take(self, message: Clock) -> None:
        with self._condition:
            self._clock = message.clock.to_sec()
            self._condition.notify_all()


class Neighbours:
    """Puts other simulators' robots into this one's world.

    Args:
        namespaces: Of the other robots.
        size: Diameter and height of the cylinder (m) that each is taken for.
        put: Takes markers, as the topic `~set_obstacles` does.
    """

    def __init__(
        self, namespaces: List[str], size: Tuple[float, float], put: Callable[[MarkerArray], None]
    ) -> None:
        self._put, self._size = put, size
        self._seen: Dict[str, float] = {}
        self._subscribers = [
            rospy.Subscriber(f"{name}/ground_truth", Odometry, self._take, name, queue_size=1, tcp_nodelay=True)
            for name in namespaces
        ]

    def _take(self, message: Odometry, name: Any) -> None:
        now = message.header.stamp.to_sec()
        if 0.0 <= now - self._seen.get(name, -PERIOD) < PERIOD:
            return
        self._seen[name] = now
        marker = Marker(header=message.header, ns=name, id=0, type=Marker.CYLINDER, action=Marker.ADD)
        marker.pose = message.pose.pose
        diameter, height = self._size
        marker.pose.position.z = height / 2.0
        marker.scale, marker.color = Vector3(diameter, diameter, height), ColorRGBA(0.3, 0.3, 0.8, 1.0)
        self._put(MarkerArray([marker]))
