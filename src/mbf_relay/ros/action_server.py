"""actionlib's ActionServer with its housekeeping on the wall clock.

The original times its status with rospy.Timer, which stops for good when the ROS clock is set back, and keeps every
finished goal for seconds of ROS time, which is for ever while the clock stands. This one publishes and forgets on the
wall clock, keeps no more than a fixed number of finished goals, and sends small messages without waiting (TCP_NODELAY).
"""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Dict, Optional

import actionlib
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

STATUS_PERIOD = 0.2
"""Wall time (s) between status messages where nothing happens: actionlib's 5 Hz."""
REMEMBER_FOR = 5.0
"""Wall time (s) for which a finished goal stays in the status: actionlib's default."""
REMEMBER_AT_MOST = 50
"""Number of finished goals kept in the status."""
MANY = 10000
"""Results that may wait for a slow client."""
UNFINISHED = frozenset((GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING))


class ActionServer(actionlib.ActionServer):
    """An ActionServer; constructor and use as actionlib's, with auto_start off.

    `lock` is the one lock of the server: goal and cancel callbacks run under it, goal handles take it.

    Args:
        name, action_type, goal_cb, cancel_cb: As actionlib's.
        recalled: Makes the result of a goal whose cancel came before it; actionlib sends an empty one, which says 0,
            and that is SUCCESS to whoever looks at the outcome alone.
    """

    def __init__(
        self, name: str, action_type: Any, goal_cb: Any, cancel_cb: Any, recalled: Optional[Callable[[], Any]] = None
    ) -> None:
        self._recalled = recalled
        self._finished_at: Dict[str, float] = {}
        self._stopped = threading.Event()
        super().__init__(name, action_type, goal_cb, cancel_cb, auto_start=False)

    def initialize(self) -> None:
        """Open the topics and start the status; overrides actionlib's, called by `start`."""
        name = rospy.remap_name(self.ns)
        queue = rospy.get_param("actionlib_server_pub_queue_size", 50)
        queue = queue if queue > 0 else 50
        results = max(queue, MANY)  # a result that is dropped leaves its client waiting for ever
        publisher = lambda kind, message, **options: rospy.Publisher(  # noqa: E731
            f"{name}/{kind}", message, tcp_nodelay=True, **{"queue_size": queue, **options}
        )
        self.status_pub = publisher("status", GoalStatusArray, latch=True)
        self.result_pub = publisher("result", self.ActionResult, queue_size=results)
        self.feedback_pub = publisher("feedback", self.ActionFeedback)
        self.goal_sub = rospy.Subscriber(f"{name}/goal", self.ActionGoal, self.internal_goal_callback, tcp_nodelay=True)
        self.cancel_sub = rospy.Subscriber(f"{name}/cancel", GoalID, self.internal_cancel_callback, tcp_nodelay=True)
        threading.Thread(target=self._keep_publishing, name=f"status of {name}", daemon=True).start()

    def stop(self) -> None:
        """Leave the topics."""
        self._stopped.set()
        with self.lock:
            self.started = False
            for link in (self.goal_sub, self.cancel_sub, self.status_pub, self.feedback_pub, self.result_pub):
                link.unregister()

    def internal_goal_callback(self, goal: Any) -> None:
        """Take a goal message; overrides actionlib's, which refuses every goal after the clock was set back."""
        with self.lock:
            if self.last_cancel > rospy.get_rostime():
                self.last_cancel = rospy.Time()
            super().internal_goal_callback(goal)

    def internal_cancel_callback(self, goal_id: GoalID) -> None:
        """Take a cancel message; overrides actionlib's, which logs errors for cancels whose goals never came."""
        with self.lock:
            early = [tracker for tracker in self.status_list if tracker.goal is None]
            self.status_list[:] = [tracker for tracker in self.status_list if tracker.goal is not None]
            super().internal_cancel_callback(goal_id)
            self.status_list.extend(tracker for tracker in early if tracker.status.goal_id.id != goal_id.id)

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Publish a goal's result; overrides actionlib's, see `recalled`."""
        if self._recalled is not None and status.status == GoalStatus.RECALLED and result == self.ActionResultType():
            result = self._recalled()
        super().publish_result(status, result)

    def publish_status(self) -> None:
        """Publish the goals at hand and those finished lately; overrides actionlib's."""
        with self.lock:
            self._forget_finished(time.monotonic())
            if self.started and not rospy.is_shutdown():
                message = GoalStatusArray(status_list=[tracker.status for tracker in self.status_list])
                message.header.stamp = rospy.get_rostime()
                self.status_pub.publish(message)

    def _keep_publishing(self) -> None:
        try:
            while not self._stopped.wait(STATUS_PERIOD) and not rospy.is_shutdown():
                self.publish_status()
        except rospy.ROSException:
            pass  # rospy closes topics from another thread when the node ends

    def _forget_finished(self, now: float) -> None:
        kept, to_drop = [], len(self.status_list) - REMEMBER_AT_MOST
        finished_at: Dict[str, float] = {}
        for tracker in self.status_list:
            goal_id = tracker.status.goal_id.id
            if tracker.status.status in UNFINISHED and tracker.goal is not None:
                kept.append(tracker)
                continue
            since = self._finished_at.get(goal_id, now)
            if to_drop > 0 or now - since > REMEMBER_FOR:
                to_drop -= 1
                continue
            finished_at[goal_id] = since
            kept.append(tracker)
        self.status_list[:] = kept
        self._finished_at = finished_at
