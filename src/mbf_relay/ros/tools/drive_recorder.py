"""Recording of a drive from the topics of a running graph."""

from __future__ import annotations

import threading
from typing import Any, Iterable, List, Optional

import roslib.message
import rospy

from mbf_relay.report.drive import Drive, GoalRecord
from mbf_relay.ros.tools.drive_events import DriveEvents

FEEDBACK_TOPIC = "move_base_flex/move_base/feedback"


class DriveRecorder:
    """Subscribes to the topics of a drive and passes their messages to DriveEvents.

    Args:
        plan_topics: Topics of global plans, in addition to the fixed topics.
    """

    def __init__(self, plan_topics: Iterable[str] = ()) -> None:
        self._lock = threading.Lock()  # rospy calls back from a thread per connection; DriveEvents takes one at a time
        self._events = DriveEvents()
        self._distance: Optional[float] = None
        self._speed = 0.0
        topics = list(self._events.handlers) + list(plan_topics) + [FEEDBACK_TOPIC]
        self._subscribers = [self._subscribe(topic) for topic in topics]

    def goals(self) -> List[GoalRecord]:
        """Return the goals so far, in the order of their arrival."""
        with self._lock:
            return self._events.goals()

    def drive(self) -> Drive:
        """Return the drive so far."""
        with self._lock:
            return self._events.drive()

    @property
    def distance_left(self) -> Optional[float]:
        """Distance (m) to the active goal by the server's last feedback, None until there is one."""
        return self._distance

    @property
    def speed(self) -> float:
        """Forward speed (m/s) by odometry."""
        return self._speed

    def close(self) -> None:
        """Unsubscribe."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _subscribe(self, topic: str) -> rospy.Subscriber:
        # Some topics differ in type from one simulator to the next, so the type is taken from the connection.
        def take(raw: Any) -> None:
            message_type = roslib.message.get_message_class(raw._connection_header["type"])
            if message_type is not None:
                self._handle(topic, message_type().deserialize(raw._buff))

        return rospy.Subscriber(topic, rospy.AnyMsg, take, queue_size=100, buff_size=1 << 22, tcp_nodelay=True)

    def _handle(self, topic: str, message: Any) -> None:
        with self._lock:
            if topic == FEEDBACK_TOPIC:
                self._distance = message.feedback.dist_to_goal
                return
            if topic.endswith("/goal"):
                self._distance = None
            elif topic == "odom":
                self._speed = message.twist.twist.linear.x
            self._events.handle(topic, message, rospy.get_time())
