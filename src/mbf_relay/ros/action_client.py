"""An action client that is ready before it sends, and that notices on the wall clock when its server is gone.

`actionlib`'s own clients learn of a server's death only from status messages, which a dead server does not send, and
count time on the ROS clock, which may stand still. Here every goal is known before it leaves, is sent again until the
server has acknowledged it (a server knows it by its id and takes it once), and ends exactly once: with the server's
result, or LOST with a text that says why. `check` does the watching; whoever waits calls it, a few times a second.
"""

from __future__ import annotations

import threading
import time
import uuid
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from mbf_relay.ros.server_watch import ServerWatch

TERMINAL = frozenset(
    (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.RECALLED)
)
RESEND_AFTER = 1.0
"""Wall time (s) without acknowledgement after which a goal is sent again."""
RESULT_PATIENCE = 2.0
"""Wall time (s) to wait for the result of a goal whose status is already terminal."""


class Ending(NamedTuple):
    """How a goal ended at the server.

    Attributes:
        status: One of actionlib_msgs/GoalStatus' terminal states; LOST where no server answers for it any more.
        text: The server's status text, or what was lost.
        result: The action's result message, None where there is none.
    """

    status: int
    text: str
    result: Optional[Any] = None


class SentGoal:
    """A goal on its way, made by `ActionClient.send`."""

    def __init__(self, client: "ActionClient", message: Any, on_feedback: Any, on_end: Any) -> None:
        self.message, self.on_feedback, self.on_end = message, on_feedback, on_end
        self.goal_id: str = message.goal_id.id
        self.ending: Optional[Ending] = None
        self.acknowledged = False
        self.sent_at = self.resent_at = time.monotonic()
        self.ended_without_result: Optional[Tuple[float, GoalStatus]] = None
        self._client = client
        self._done = threading.Event()

    def cancel(self) -> None:
        """Ask the server to cancel this goal; may be repeated."""
        self._client.cancel(self.goal_id)

    def wait(self, timeout: Optional[float] = None) -> Optional[Ending]:
        """Return how the goal ended, None after `timeout` seconds of wall time or at shutdown."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._done.wait(0.1) and not rospy.is_shutdown():
            if deadline is not None and time.monotonic() > deadline:
                break
            self._client.check()
        return self.ending

    def finish(self, ending: Ending) -> None:
        """Note how it ended and tell whoever sent it; called once, by the client."""
        self.ending = ending
        self._done.set()
        if self.on_end is not None:
            self.on_end(ending)


class ActionClient:
    """Sends goals to one action server.

    One lock guards the table of goals; callbacks run without it, so they may send and cancel.
    """

    def __init__(self, name: str, action_type: Any, acknowledge_timeout: float = 10.0, silence_timeout: float = 5.0) -> None:
        """Connect to an action.

        Args:
            name: The action's name.
            action_type: Its generated `...Action` message.
            acknowledge_timeout: Wall time (s) after which a goal the server never acknowledged is LOST.
            silence_timeout: Wall time (s) of a connected server's silence after which it counts as gone.
        """
        action = action_type()
        self.name = rospy.resolve_name(name)
        self._goal_type = type(action.action_goal)
        self._acknowledge_timeout = acknowledge_timeout
        self._lock = threading.Lock()
        self._goals: Dict[str, SentGoal] = {}
        self._life = uuid.uuid4().hex[:8]
        self._count = 0
        publisher, subscriber = rospy.Publisher, rospy.Subscriber
        self._goal_publisher = publisher(f"{self.name}/goal", self._goal_type, queue_size=100, tcp_nodelay=True)
        self._cancel_publisher = publisher(f"{self.name}/cancel", GoalID, queue_size=100, tcp_nodelay=True)
        feedback, result = type(action.action_feedback), type(action.action_result)
        self._subscribers = [
            subscriber(f"{self.name}/result", result, self._take_result, tcp_nodelay=True),
            subscriber(f"{self.name}/feedback", feedback, self._take_feedback, tcp_nodelay=True),
        ]
        self._watch = ServerWatch(
            self.name, self._goal_publisher.impl.has_connection, silence_timeout, self._take_status)

    @property
    def server_is_up(self) -> bool:
        """Whether a server has been heard and is connected both ways, so that a goal sent now will arrive."""
        links = (*self._subscribers, self._goal_publisher, self._cancel_publisher)
        return self._watch.is_up and self._watch.is_connected and all(link.get_num_connections() for link in links)

    @property
    def server_silence(self) -> float:
        """Wall time (s) since the server's last word, infinite before the first."""
        return self._watch.silence

    @property
    def why_down(self) -> str:
        """Why `server_is_up` is False: how the server was lost, where it was."""
        lost = "" if self._watch.is_up else self._watch.loss
        return lost or f"action server {self.name} is not there; is it running?"

    def wait_for_server(self, timeout: float) -> bool:
        """Wait up to `timeout` seconds of wall time for a server; tell whether there is one."""
        deadline = time.monotonic() + timeout
        while not self.server_is_up and time.monotonic() < deadline and not rospy.is_shutdown():
            self.check()
            time.sleep(0.02)
        return self.server_is_up

    def send(
        self, goal: Any, on_feedback: Optional[Callable[[Any], None]] = None, on_end: Optional[Callable[[Ending], None]] = None
    ) -> SentGoal:
        """Send a goal.

        Args:
            goal: The action's goal message.
            on_feedback: Called with each feedback message.
            on_end: Called once with the goal's ending, perhaps before this method has returned.
        """
        now = rospy.get_rostime()
        with self._lock:
            self._count += 1
            goal_id = GoalID(stamp=now, id=f"{rospy.get_name()}-{self._life}-{self._count}")
            message = self._goal_type(goal_id=goal_id, goal=goal)
            message.header.stamp = now
            sent = self._goals[goal_id.id] = SentGoal(self, message, on_feedback, on_end)
        self._goal_publisher.publish(message)
        return sent

    def cancel(self, goal_id: str) -> None:
        """Ask the server to cancel the goal with this id."""
        self._cancel_publisher.publish(GoalID(id=goal_id))

    def check(self) -> None:
        """Send again what was not acknowledged; end what no server answers for any more. Call a few times a second."""
        now = time.monotonic()
        lost = self._watch.why_lost(now)
        with self._lock:
            goals = list(self._goals.values())
        for sent in goals:
            if lost is not None:
                self._end(sent, Ending(GoalStatus.LOST, lost))
            elif sent.ended_without_result is not None and now - sent.ended_without_result[0] > RESULT_PATIENCE:
                status = sent.ended_without_result[1]
                self._end(sent, Ending(status.status, status.text))
            elif not sent.acknowledged:
                self._press(sent, now)

    def cancel_all(self) -> None:
        """Ask the server to cancel every goal of this client's that has not ended; for a program that is interrupted."""
        for goal_id in self.open_goals:
            self.cancel(goal_id)

    def close(self) -> None:
        """Leave the action."""
        self._watch.close()
        for link in (*self._subscribers, self._goal_publisher, self._cancel_publisher):
            link.unregister()

    def _press(self, sent: SentGoal, now: float) -> None:
        """Send an unacknowledged goal once more, or give it up."""
        if now - sent.sent_at > self._acknowledge_timeout:
            text = f"action server {self.name} did not acknowledge the goal within {self._acknowledge_timeout:g} s"
            self._end(sent, Ending(GoalStatus.LOST, text))
        elif now - sent.resent_at > RESEND_AFTER:
            sent.resent_at = now
            self._goal_publisher.publish(sent.message)

    def _take_status(self, message: GoalStatusArray) -> None:
        with self._lock:
            goals = list(self._goals.values())
        if not goals:
            return
        listed = {status.goal_id.id: status for status in message.status_list}
        for sent in goals:
            status = listed.get(sent.goal_id)
            if status is not None:
                sent.acknowledged = True
                if status.status in TERMINAL and sent.ended_without_result is None:
                    sent.ended_without_result = (time.monotonic(), status)
            elif sent.acknowledged and sent.ended_without_result is None:
                self._end(sent, Ending(GoalStatus.LOST, f"action server {self.name} was restarted or dropped the goal"))

    def _take_feedback(self, message: Any) -> None:
        sent = self._goals.get(message.status.goal_id.id)
        if sent is not None and sent.on_feedback is not None:
            sent.on_feedback(message.feedback)

    def _take_result(self, message: Any) -> None:
        sent = self._goals.get(message.status.goal_id.id)
        if sent is not None:
            self._end(sent, Ending(message.status.status, message.status.text, message.result))

    def _end(self, sent: SentGoal, ending: Ending) -> None:
        with self._lock:
            still_open = self._goals.pop(sent.goal_id, None) is not None
        if still_open:
            if ending.status == GoalStatus.LOST:
                self.cancel(sent.goal_id)  # a server that only hung must not go on with what was given up
            sent.finish(ending)

    @property
    def open_goals(self) -> List[str]:
        """The ids of the goals that have not ended."""
        with self._lock:
            return list(self._goals)
