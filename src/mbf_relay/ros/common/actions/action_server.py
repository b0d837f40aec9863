"""An action server on the wall clock, by actionlib's protocol.

Own code, because actionlib's times its status with rospy.Timer, which stops for good when the ROS clock is set back,
keeps finished goals for ever while that clock stands, lets them begin anew, and never notices that a client is gone.
The goals themselves are kept by `goal_tracker`; here are the topics, sent without waiting (TCP_NODELAY), and the thread
that repeats the status.
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
from mbf_relay.ros.common.actions.goal_tracker import FIRST_WORD, GoalTracker, TrackedGoal
from mbf_relay.ros.common.connected_nodes import connected_nodes

STATUS_PERIOD = 0.2
"""Wall time (s) between status messages where nothing happens: actionlib's 5 Hz."""
LOOK_PERIOD = 0.1
"""Wall time (s) between two looks at leases, and at a status that waits to be told."""
STATUSES_PER_SECOND = 2000.0
"""Goals' states told in a second where much happens: what a client in Python takes in beside its work."""
MANY = 10000
"""Results that may wait for a slow client."""
LATE = 5.0
"""Wall time (s) by which a client's connection for results may come after the one for its goals."""


class _LateComers(rospy.SubscribeListener):
    """Sends results of just now to a client whose connection for them stood only after they were sent.

    A subscriber counts its connection as soon as it has asked for it; on a busy machine the publisher may be a second
    behind, and a goal that ends at once would have no result for its client.
    """

    def __init__(self) -> None:
        self._sent: Deque[Tuple[float, Any]] = collections.deque(maxlen=MANY)

    def note(self, message: Any) -> None:
        """Keep a result that is sent now."""
        self._sent.append((time.monotonic(), message))

    def forget(self) -> None:
        """Let go of what was sent too long ago; call now and then, whether or not anything is sent."""
        oldest = time.monotonic() - LATE
        while self._sent and self._sent[0][0] < oldest:
            self._sent.popleft()

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Callable[[Any], None]) -> None:
        """Send what was sent lately to who has come now."""
        oldest = time.monotonic() - LATE
        for sent_at, message in list(self._sent):
            if sent_at >= oldest:
                peer_publish(message)


class ActionServer:
    """Serves one action; constructor and use as actionlib's, with auto_start off.

    Attributes:
        lock: The one lock of the server: goal and cancel callbacks run under it, goals take it.
        is_stopped: Whether it has left the topics for good.
        tells_of_goals: Whether its last status told of any, be it that they ended lately.
    """

    def __init__(
        self, name: str, action_type: Any, goal_cb: Callable[[TrackedGoal], None],
        cancel_cb: Callable[[TrackedGoal], None], recalled: Optional[Callable[[], Any]] = None,
        client_timeout: float = 0.0, overtaken_cb: Callable[[TrackedGoal], None] = lambda goal: None,
        is_alive: Callable[[], bool] = lambda: True,
    ) -> None:
        """Make a server, not yet advertised.

        Args:
            name, action_type, goal_cb, cancel_cb: As actionlib's.
            recalled: Makes the result of a goal whose cancel came before it, where that is not an empty one.
            client_timeout: Wall time (s) after which the goals of a client that disconnected end; 0 for never.
            overtaken_cb: Called with a goal whose cancel came before it, before that goal ends.
            is_alive: Tells whether what carries out goals works; while it does not, no status is told.
        """
        action = action_type()
        self._name, self._client_timeout = name, client_timeout
        self._goal_type, self._result_type = type(action.action_goal), type(action.action_result)
        self._feedback_type = type(action.action_feedback)
        empty = type(action.action_result.result)
        self.goals = GoalTracker(
            self, goal_cb, cancel_cb, empty, time.monotonic, rospy.get_rostime, recalled, overtaken_cb, FIRST_WORD)
        self.lock = self.goals.lock
        self._is_alive = is_alive
        self._late_comers = _LateComers()
        self.is_stopped = self.tells_of_goals = False
        self._changed = False
        self._told_at = self._wait = 0.0
        self._publishes = False
        self._trouble = ""  # of the last message that could not be written

    def start(self) -> None:
        """Open the topics and begin to tell the status."""
        start_together([self])

    def open(self) -> None:
        """Open the topics; who calls this has `look` called from then on."""
        name = rospy.remap_name(self._name)
        queue = rospy.get_param("actionlib_server_pub_queue_size", 50)
        queue = queue if queue > 0 else 50
        results = max(queue, MANY)  # a result that is dropped leaves its client waiting for ever
        publisher, subscriber = rospy.Publisher, rospy.Subscriber
        with self.lock:
            self._status = publisher(f"{name}/status", GoalStatusArray, queue_size=queue, latch=True, tcp_nodelay=True)
            self._result = publisher(
                f"{name}/result", self._result_type, self._late_comers, queue_size=results, tcp_nodelay=True)
            self._feedback = publisher(f"{name}/feedback", self._feedback_type, queue_size=queue, tcp_nodelay=True)
            # renewals first: who can send goals can renew them
            renewals = subscriber(f"{name}/lease", GoalID, lambda m: self.goals.renew(m.id), tcp_nodelay=True)
            self._cancel_link = subscriber(f"{name}/cancel", GoalID, self.goals.take_cancel, tcp_nodelay=True)
            # goals last: who the master knows to take them serves all the rest (see server_watch.check_alone)
            self._goal_link = subscriber(f"{name}/goal", self._goal_type, self._take_goal, tcp_nodelay=True)
            self._links = [self._status, self._result, self._feedback, renewals, self._cancel_link, self._goal_link]
            self._publishes = True
            self.publish_status()

    def stop(self) -> None:
        """Leave the topics."""
        with self.lock:
            self.goals.speak()
            self._publishes, self.is_stopped = False, True
            for link in self._links:
                link.unregister()

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Send a goal's result.

        One that cannot be written would leave its client waiting for ever: the goal is aborted then, with an empty one.
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
        """Send feedback of a goal."""
        message = self._feedback_type(status=status, feedback=feedback)
        message.header.stamp = rospy.get_rostime()
        self._publish(self._feedback, message)

    def publish_status(self) -> None:
        """Send the goals at hand and those finished lately."""
        with self.lock:
            self._told_at = time.monotonic()
            self._changed = False
            message = GoalStatusArray(status_list=self.goals.listed())
            message.header.stamp = rospy.get_rostime()
            self.tells_of_goals = bool(message.status_list)
            self._wait = min(STATUS_PERIOD, len(message.status_list) / STATUSES_PER_SECOND)
            self._publish(self._status, message)

    def status_changed(self) -> None:
        """Tell the new status: at once, or where it is long and was told just now, a moment later."""
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
        """Send a message; returns why it cannot be written, empty where it can."""
        try:
            if self._publishes and not rospy.is_shutdown():
                publisher.publish(message)
        except Exception as error:
            closed = isinstance(error, rospy.ROSException) and not isinstance(error, rospy.ROSSerializationException)
            if not closed:  # as rospy does with topics from another thread when the node ends
                trouble = as_told(f"{type(error).__name__}: {error}")
                if trouble != self._trouble:
                    rospy.logerr("%s cannot be sent on %s: %s", type(message).__name__, publisher.name, trouble)
                self._trouble = trouble
                return trouble
        return ""

    def look(self) -> None:
        """Look at leases, and tell the status where it is time; call every LOOK_PERIOD."""
        self.goals.look(self._is_connected, self._client_timeout)
        self._late_comers.forget()
        if self._is_alive() and time.monotonic() - self._told_at >= (self._wait if self._changed else STATUS_PERIOD):
            self.publish_status()

    def _is_connected(self, node: str) -> bool:
        """Return whether a node that sends goals is connected."""
        return any(node in connected_nodes(link) for link in (self._goal_link, self._cancel_link))


def start_together(servers: Sequence[ActionServer]) -> None:
    """Start servers of one node; one thread tells the status of all, as what waking one costs is most of the work."""
    for server in servers:
        server.open()
    threading.Thread(target=_keep_telling, args=(servers,), name="status of actions", daemon=True).start()


def _keep_telling(servers: Sequence[ActionServer]) -> None:
    told = False
    while not (rospy.is_shutdown() or all(server.is_stopped for server in servers)):
        for server in servers:
            if not server.is_stopped:
                server.look()
        tell = any(server.tells_of_goals for server in servers)
        if told and not tell:
            give_back_free()  # what goals took: nobody waits for this node any more, and nobody yet
        told = tell
        time.sleep(LOOK_PERIOD)
