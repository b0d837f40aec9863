"""An action server by actionlib's protocol, timed by the wall clock.

It replaces actionlib's, which publishes its status by rospy.Timer, and that stops for good when the ROS clock is set
back; which keeps finished goals for ever while that clock stands still, can start them a second time, and never notices
that a client is gone. `goal_tracker` keeps the goals; this module has the topics (TCP_NODELAY) and the thread that
repeats the status.
"""

from __future__ import annotations

import collections
import threading
import time
from typing import Any, Callable, Deque, Optional, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from mbf_relay.memory import give_back_free
from mbf_relay.outcomes import as_told
from mbf_relay.ros.common.actions.goal_tracker import HELD_BACK_FOR, GoalTracker, TrackedGoal
from mbf_relay.ros.common.connected_nodes import connected_nodes

STATUS_PERIOD = 0.2
"""Wall time (s) between status messages without changes: actionlib's 5 Hz."""
LOOK_PERIOD = 0.1
"""Wall time (s) between two calls of `update`, which checks leases and publishes a delayed status."""
STATUSES_PER_SECOND = 2000.0
"""Largest rate at which states of goals are published: as many as a Python client can handle beside its work."""
MANY = 10000
"""Queue size for results."""
LATE = 5.0
"""Wall time (s) for which results are kept for a client whose connection to the result topic is late."""


class _LateComers(rospy.SubscribeListener):
    """Sends recent results to a client whose connection to the result topic was established only after they were sent.

    A subscriber counts a connection once it has requested it. On a busy machine the publisher may be a second behind,
    and the result of a goal that ends at once would not reach its client.
    """

    def __init__(self) -> None:
        self._sent: Deque[Tuple[float, Any]] = collections.deque(maxlen=MANY)

    def note(self, message: Any) -> None:
        """Keep a result that is being published."""
        self._sent.append((time.monotonic(), message))

    def forget(self) -> None:
        """Drop results older than LATE; call regularly."""
        oldest = time.monotonic() - LATE
        while self._sent and self._sent[0][0] < oldest:
            self._sent.popleft()

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Callable[[Any], None]) -> None:
        """Send the recent results to a new subscriber."""
        oldest = time.monotonic() - LATE
        for sent_at, message in list(self._sent):
            if sent_at >= oldest:
                peer_publish(message)


class ActionServer:
    """Serves one action; constructor and use are those of actionlib.ActionServer with auto_start=False.

    Attributes:
        lock: The server's only lock, re-entrant; goal and cancel callbacks run with it held.
        is_stopped: Whether `stop` was called.
        tells_of_goals: Whether its last status message had any goals, those that ended lately included.
    """

    def __init__(
        self, name: str, action_type: Any, goal_cb: Callable[[TrackedGoal], None],
        cancel_cb: Callable[[TrackedGoal], None], recalled: Optional[Callable[[], Any]] = None,
        client_timeout: float = 0.0, overtaken_cb: Callable[[TrackedGoal], None] = lambda goal: None,
        is_alive: Callable[[], bool] = lambda: True,
    ) -> None:
        """Make a server, not yet advertised.

        Args:
            name, action_type, goal_cb, cancel_cb: As for actionlib.ActionServer.
            recalled: Returns the result of a goal whose cancel arrived before it; an empty one where None.
            client_timeout: Wall time (s) after which the goals of a disconnected client are cancelled; 0 for never.
            overtaken_cb: Called with a goal whose cancel arrived before it, before the goal is ended.
            is_alive: Returns whether goals are being processed; while not, no status is published, so that clients
                notice.
        """
        action = action_type()
        self._name, self._client_timeout = name, client_timeout
        self._goal_type, self._result_type = type(action.action_goal), type(action.action_result)
        self._feedback_type = type(action.action_feedback)
        empty = type(action.action_result.result)
        self.goals = GoalTracker(
            self, goal_cb, cancel_cb, empty, time.monotonic, rospy.get_rostime, recalled, overtaken_cb, HELD_BACK_FOR)
        self.lock = self.goals.lock
        self._is_alive = is_alive
        self._late_comers = _LateComers()
        self.is_stopped = self.tells_of_goals = False
        self._changed = False
        self._told_at = self._wait = 0.0
        self._publishes = False
        self._trouble = ""  # of the last message that could not be written

    def start(self) -> None:
        """Advertise the topics and start to publish the status."""
        start_together([self])

    def open(self) -> None:
        """Advertise the topics; the caller then has to call `update` regularly."""
        name = rospy.resolve_name(self._name)
        queue = rospy.get_param("actionlib_server_pub_queue_size", 50)
        queue = queue if queue > 0 else 50
        results = max(queue, MANY)  # a result that is dropped leaves its client waiting for ever
        publisher, subscriber = rospy.Publisher, rospy.Subscriber
        with self.lock:
            self._status = publisher(f"{name}/status", GoalStatusArray, queue_size=queue, latch=True, tcp_nodelay=True)
            self._result = publisher(
                f"{name}/result", self._result_type, self._late_comers, queue_size=results, tcp_nodelay=True)
            self._feedback = publisher(f"{name}/feedback", self._feedback_type, queue_size=queue, tcp_nodelay=True)
            # renewals first, so that a client which can send goals can also renew them
            renewals = subscriber(f"{name}/lease", GoalID, lambda m: self.goals.renew(m.id), tcp_nodelay=True)
            self._cancel_link = subscriber(f"{name}/cancel", GoalID, self.goals.take_cancel, tcp_nodelay=True)
            # goals last, so that a node registered for them has all other topics (see server_watch.check_alone)
            self._goal_link = subscriber(f"{name}/goal", self._goal_type, self._take_goal, tcp_nodelay=True)
            self._links = [self._status, self._result, self._feedback, renewals, self._cancel_link, self._goal_link]
            self._publishes = True
            self.publish_status()

    def stop(self) -> None:
        """Publish what is pending and unadvertise the topics."""
        with self.lock:
            self.goals.release()
            self._publishes, self.is_stopped = False, True
            for link in self._links:
                link.unregister()

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Publish a goal's result; where it cannot be serialized, an empty one with the goal ABORTED.

        Without any result the client would wait for ever.
        """
        message = self._result_type(status=status, result=result)
        message.header.stamp = rospy.get_rostime()
        self._late_comers.note(message)
        trouble = self._publish(self._result, message)
        if trouble:
            status.status, status.text = GoalStatus.ABORTED, f"the result cannot be sent: {trouble}"
            message.result = type(result)()
            self._publish(self._result, message)

    def publish_feedback(self, status: GoalStatus, feedback: Any) -> None:
        """Publish feedback of a goal."""
        message = self._feedback_type(status=status, feedback=feedback)
        message.header.stamp = rospy.get_rostime()
        self._publish(self._feedback, message)

    def publish_status(self) -> None:
        """Publish the status of all goals that have not ended, and of those that ended lately."""
        with self.lock:
            self._told_at = time.monotonic()
            self._changed = False
            message = GoalStatusArray(status_list=self.goals.listed())
            message.header.stamp = rospy.get_rostime()
            self.tells_of_goals = bool(message.status_list)
            self._wait = min(STATUS_PERIOD, len(message.status_list) / STATUSES_PER_SECOND)
            self._publish(self._status, message)

    def status_changed(self) -> None:
        """Publish the status at once, or, where it is long and was published just now, a moment later by `update`."""
        with self.lock:
            if not self._publishes:
                return
            if time.monotonic() - self._told_at >= self._wait:
                self.publish_status()
            else:
                self._changed = True

    def _take_goal(self, message: Any) -> None:
        client = message._connection_header.get("callerid", "")
        self.goals.take_goal(message.goal_id, message.goal, client)

    def _publish(self, publisher: Any, message: Any) -> str:
        """Publish a message; return why it cannot be serialized, empty where it can."""
        try:
            if self._publishes and not rospy.is_shutdown():
                publisher.publish(message)
        except Exception as error:
            closed = isinstance(error, rospy.ROSException) and not isinstance(error, rospy.ROSSerializationException)
            if not closed:  # rospy closes topics from another thread when the node ends
                trouble = as_told(f"{type(error).__name__}: {error}")
                if trouble != self._trouble:
                    rospy.logerr("%s cannot be sent on %s: %s", type(message).__name__, publisher.name, trouble)
                self._trouble = trouble
                return trouble
        return ""

    def update(self) -> None:
        """Check leases, and publish the status where it is due; call every LOOK_PERIOD."""
        self.goals.update(self._is_connected, self._client_timeout)
        self._late_comers.forget()
        if self._is_alive() and time.monotonic() - self._told_at >= (self._wait if self._changed else STATUS_PERIOD):
            self.publish_status()

    def _is_connected(self, node: str) -> bool:
        """Return whether a node that sends goals is connected."""
        return any(node in connected_nodes(link) for link in (self._goal_link, self._cancel_link))


def start_together(servers: Sequence[ActionServer]) -> None:
    """Start several servers of a node with one thread for all, as waking a thread is most of the work."""
    for server in servers:
        server.open()
    threading.Thread(target=_keep_telling, args=(servers,), name="status of actions", daemon=True).start()


def _keep_telling(servers: Sequence[ActionServer]) -> None:
    told = False
    while not (rospy.is_shutdown() or all(server.is_stopped for server in servers)):
        for server in servers:
            if not server.is_stopped:
                server.update()
        tell = any(server.tells_of_goals for server in servers)
        if told and not tell:
            give_back_free()  # memory of goals, returned now as no client is waiting
        told = tell
        time.sleep(LOOK_PERIOD)
