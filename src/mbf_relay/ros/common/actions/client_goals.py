"""The goals of an action client: resent until acknowledged, leases renewed, each ended exactly once.

This part knows neither topics nor threads; `action_client` connects it. It replaces actionlib's clients, which publish
a goal before they register it, use the ROS clock, which may stand still, and learn of the end of goals only from status
messages, which a dead server does not send.
"""

from __future__ import annotations

import itertools
import re
import threading
import time
import uuid
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Protocol, Tuple

from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from mbf_relay.ros.common.actions import goal_lease

TERMINAL = frozenset(
    (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.RECALLED)
)
"""States in which a goal has ended."""
RESEND_AFTER = 1.0
"""Wall time (s) without acknowledgement after which a goal, or the cancel of a cancelled one, is sent again."""
RESULT_PATIENCE = 2.0
"""Wall time (s) to wait for the result of a goal whose status is already terminal."""


class ActionEnding(NamedTuple):
    """How a goal ended at the server.

    Attributes:
        status: A terminal state of actionlib_msgs/GoalStatus; LOST where the server is gone or has lost the goal.
        text: The server's status text, or why it is LOST.
        result: The action's result message, None where there is none.
    """

    status: int
    text: str
    result: Optional[Any] = None


class GoalLinks(Protocol):
    """What ClientGoals needs of the topics."""

    @property
    def takes_leases(self) -> bool:
        """Whether goals are to be leased and the server supports that."""

    def publish_goal(self, message: Any) -> None:
        """Send a goal message."""

    def publish_cancel(self, goal_id: GoalID) -> None:
        """Send a cancel."""

    def renew(self, goal_id: GoalID) -> None:
        """Send the renewal of a lease."""


class SentGoal:
    """A goal that was sent, made by `ClientGoals.send`.

    Attributes:
        goal_id: Its id.
        ending: How it ended, None before.
        acknowledged: Whether a status message has listed it.
        ended_without_result: Wall time (s) and status where the status is terminal and the result has not come yet.
    """

    def __init__(self, owner: ClientGoals, message: Any, on_feedback: Any, on_end: Any, now: float) -> None:
        self.message, self.on_feedback, self.on_end = message, on_feedback, on_end
        self.goal_id: str = message.goal_id.id
        self.ending: Optional[ActionEnding] = None
        self.acknowledged = self.is_cancelled = False
        self.sent_at = self.resent_at = now
        self.ended_without_result: Optional[Tuple[float, GoalStatus]] = None
        self._owner = owner
        self._done = threading.Event()

    def cancel(self) -> None:
        """Ask the server to cancel this goal, and stop renewing its lease; may be repeated."""
        self.is_cancelled = True
        self._owner.cancel(self.goal_id)

    def wait(self, timeout: Optional[float] = None) -> Optional[ActionEnding]:
        """Return how the goal ended, None after `timeout` seconds of wall time or at shutdown."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._done.wait(0.1) and self._owner.keep_up():
            if deadline is not None and time.monotonic() > deadline:
                break
        return self.ending

    def finish(self, ending: ActionEnding) -> None:
        """Set its ending and call `on_end`; called once, by the client.

        The callbacks are dropped, as they often refer to the goal, and a reference cycle would keep both in memory.
        """
        self.ending, on_end = ending, self.on_end
        self.on_feedback = self.on_end = None
        self._done.set()
        if on_end is not None:
            on_end(ending)


class ClientGoals:
    """The goals of one client of one action.

    One lock guards the table of goals; callbacks run without it, so they may send and cancel.
    """

    LIFE = uuid.uuid4().hex[:8]
    """Part of the goal ids that is different for each process, so that an earlier process' goals are recognized."""
    _numbers = itertools.count(1)

    def __init__(
        self, name: str, node: str, goal_type: Any, links: GoalLinks, acknowledge_timeout: float,
        clock: Callable[[], float], ros_now: Callable[[], Any], keep_up: Optional[Callable[[], bool]] = None,
        life: str = LIFE,
    ) -> None:
        """Begin without goals.

        Args:
            name: The action's name.
            node: This node's name, with which goal ids begin.
            goal_type: The action's generated `...ActionGoal` message.
            links: Publishes to the server.
            acknowledge_timeout: Wall time (s) after which a goal the server never acknowledged is LOST.
            clock: Gives wall time (s).
            ros_now: Gives ROS time as rospy.Time.
            keep_up: Called by `SentGoal.wait` while it waits; calls `check` and returns whether to wait on.
            life: See LIFE.
        """
        self.name = name
        self._node, self._life, self._goal_type, self._links = node, life, goal_type, links
        self._own_id = re.compile(rf"{re.escape(node)}-(?P<life>[0-9a-f]{{8}})-\d+({re.escape(goal_lease.MARK)})?$")
        self._acknowledge_timeout, self._clock, self._ros_now = acknowledge_timeout, clock, ros_now
        self.keep_up: Callable[[], bool] = keep_up or (lambda: False)
        self._lock = threading.Lock()
        self._goals: Dict[str, SentGoal] = {}

    def send(
        self, goal: Any, on_feedback: Optional[Callable[[Any], None]] = None,
        on_end: Optional[Callable[[ActionEnding], None]] = None,
    ) -> SentGoal:
        """Send a goal.

        Args:
            goal: The action's goal message.
            on_feedback: Called with each feedback message.
            on_end: Called once with the goal's ending, perhaps before this method has returned.
        """
        now = self._ros_now()
        mark = goal_lease.MARK if self._links.takes_leases else ""
        with self._lock:
            goal_id = GoalID(stamp=now, id=f"{self._node}-{self._life}-{next(self._numbers)}{mark}")
            message = self._goal_type(goal_id=goal_id, goal=goal)
            message.header.stamp = now
            sent = self._goals[goal_id.id] = SentGoal(self, message, on_feedback, on_end, self._clock())
        self._links.publish_goal(message)
        return sent

    def cancel(self, goal_id: str) -> None:
        """Ask the server to cancel the goal with this id."""
        self._links.publish_cancel(GoalID(id=goal_id))

    def cancel_all(self) -> None:
        """Ask the server to cancel all goals of this client that have not ended."""
        for sent in self._open():
            sent.cancel()

    def check(self, lost: Optional[str] = None) -> None:
        """Renew leases, resend goals that were not acknowledged, end lost ones; call about every 0.1 s.

        Args:
            lost: Why the server is gone; None where it is not.
        """
        now = self._clock()
        for sent in self._open():
            if lost is not None:
                self._end(sent, ActionEnding(GoalStatus.LOST, lost))
            elif sent.ended_without_result is not None and now - sent.ended_without_result[0] > RESULT_PATIENCE:
                status = sent.ended_without_result[1]
                self._end(sent, ActionEnding(status.status, status.text))
            else:
                if goal_lease.is_leased(sent.goal_id) and not sent.is_cancelled:
                    self._links.renew(GoalID(id=sent.goal_id))
                if not sent.acknowledged:
                    self._press(sent, now)

    def take_status(self, message: GoalStatusArray) -> None:
        """Take a status message: cancel goals that an earlier process of this node left, and update this one's."""
        listed = {status.goal_id.id: status for status in message.status_list}
        for goal_id, status in listed.items():
            made_here = self._own_id.match(goal_id)
            runs = status.status in (GoalStatus.PENDING, GoalStatus.ACTIVE)
            if made_here and runs and made_here.group("life") != self._life:
                self.cancel(goal_id)
        for sent in self._open():
            status = listed.get(sent.goal_id)
            if status is not None:
                sent.acknowledged = True
                if status.status == GoalStatus.RECALLING:  # the goal was lost, and the server has its cancel alone
                    self._resend(sent, self._clock(), sent.message)
                if status.status in TERMINAL and sent.ended_without_result is None:
                    sent.ended_without_result = (self._clock(), status)
            elif sent.acknowledged and sent.ended_without_result is None:
                self._end(
                    sent, ActionEnding(GoalStatus.LOST, f"action server {self.name} was restarted or dropped the goal")
                )

    def take_feedback(self, message: Any) -> None:
        """Take a feedback message."""
        sent = self._goals.get(message.status.goal_id.id)
        on_feedback = None if sent is None else sent.on_feedback
        if on_feedback is not None:
            on_feedback(message.feedback)

    def take_result(self, message: Any) -> None:
        """Take a result message."""
        sent = self._goals.get(message.status.goal_id.id)
        if sent is not None:
            self._end(sent, ActionEnding(message.status.status, message.status.text, message.result))

    def knows(self, goal_id: str) -> bool:
        """Return whether a goal of this client has that id and has not ended."""
        return goal_id in self._goals

    @property
    def open_goals(self) -> List[str]:
        """The ids of the goals that have not ended."""
        return [sent.goal_id for sent in self._open()]

    def _open(self) -> List[SentGoal]:
        with self._lock:
            return list(self._goals.values())

    def _press(self, sent: SentGoal, now: float) -> None:
        """Resend an unacknowledged goal, or end it as LOST."""
        if now - sent.sent_at > self._acknowledge_timeout:
            text = f"action server {self.name} did not acknowledge the goal within {self._acknowledge_timeout:g} s"
            self._end(sent, ActionEnding(GoalStatus.LOST, text))
        else:
            # A cancelled goal is not sent again: the robot would drive until the cancel comes.
            self._resend(sent, now, None if sent.is_cancelled else sent.message)

    def _resend(self, sent: SentGoal, now: float, message: Optional[Any]) -> None:
        """Send a goal's message again, or its cancel where that is None, at most once in RESEND_AFTER."""
        if now - sent.resent_at > RESEND_AFTER:
            sent.resent_at = now
            if message is None:
                self.cancel(sent.goal_id)
            else:
                self._links.publish_goal(message)

    def _end(self, sent: SentGoal, ending: ActionEnding) -> None:
        with self._lock:
            still_open = self._goals.pop(sent.goal_id, None) is not None
        if still_open:
            sent.cancel()  # in case the server still pursues it
            sent.finish(ending)
