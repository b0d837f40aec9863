"""Several simulators in one ROS graph: one publishes /clock, the others follow it, and each robot sees the others.

Each simulator has its own physics, in which the other robots are obstacles at the poses on their `ground_truth`.
"""

from __future__ import annotations

import math
import threading
from typing import Any, Callable, Dict, List, Tuple

import rospy
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

PERIOD = 0.1
"""Seconds between two updates of a neighbour's pose; a burger drives 22 mm meanwhile."""
PATIENCE = 0.1
"""Wall seconds to wait for the clock before whoever waits may do something else."""


class ClockFollower:
    """Paces a simulation by another node's /clock; stands in for `pacing.RealTimePacer`.

    The simulation takes that time over with the first message, and where it is set back.

    Args:
        now: Returns the simulation's time (s).
        set_time: Has the simulation show another time (s); called by whoever calls `pace`.
    """

    def __init__(self, now: Callable[[], float], set_time: Callable[[float], None]) -> None:
        self._now, self._set_time = now, set_time
        self._condition = threading.Condition()  # guards the two below; nothing else is locked while it is held
        self._clock = math.inf
        self._is_another = False  # time, and not the same going on
        rospy.Subscriber("/clock", Clock, self._take, queue_size=1, tcp_nodelay=True)

    def restart(self) -> None:
        """Begin anew after a pause: what was missed is made up for, as the clock went on."""

    def pace(self, _simulated: float) -> bool:
        """Wait a little for the clock; return whether it is past the simulation."""
        with self._condition:
            self._condition.wait_for(lambda: self._is_another or self._is_past(), PATIENCE)
            another, self._is_another, clock = self._is_another, False, self._clock
        if another:
            self._set_time(clock)
        return self._is_past()

    def _is_past(self) -> bool:
        return self._now() <= self._clock < math.inf

    def _take(self, message: Clock) -> None:
        with self._condition:
            before, self._clock = self._clock, message.clock.to_sec()
            self._is_another |= self._clock < before
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
        for name in namespaces:
            rospy.Subscriber(f"{name}/ground_truth", Odometry, self._take, name, queue_size=1, tcp_nodelay=True)

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
