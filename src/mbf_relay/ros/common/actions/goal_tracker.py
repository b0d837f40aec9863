"""The goals of an action server, with actionlib's state transitions as a table; without topics and threads.

It replaces the bookkeeping of actionlib's ActionServer, which can start a finished goal again (after a cancel, its goal
and the cancel again), forgets goals by the ROS clock, which may stand still or be set back, and does not notice that a
client is gone.
"""

from __future__ import annotations

import itertools
import logging
import math
import threading
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Protocol

from actionlib_msgs.msg import GoalID, GoalStatus
from genpy import Time

from mbf_relay.ros.common.actions.goal_lease import DURATION, is_leased

PENDING, ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED, PREEMPTING, RECALLING, RECALLED = range(9)
"""actionlib_msgs/GoalStatus' numbers."""
TRANSITIONS: Mapping[str, Mapping[int, int]] = {
    "accept": {PENDING: ACTIVE, RECALLING: PREEMPTING},
    "reject": {PENDING: REJECTED, RECALLING: REJECTED},
    "request cancel": {PENDING: RECALLING, ACTIVE: PREEMPTING},
    "cancel": {PENDING: RECALLED, RECALLING: RECALLED, ACTIVE: PREEMPTED, PREEMPTING: PREEMPTED},
    "abort": {ACTIVE: ABORTED, PREEMPTING: ABORTED},
    "succeed": {ACTIVE: SUCCEEDED, PREEMPTING: SUCCEEDED},
}
"""actionlib's transitions: for each event the states in which it is allowed, and the next state (wiki:
actionlib/DetailedDescription)."""
TERMINAL: FrozenSet[int] = frozenset((PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED))
"""States in which a goal has ended."""

LIST_FOR = 5.0
"""Wall time (s) for which the status lists a finished goal, or a cancel without its goal: actionlib's default."""
REMEMBER_FOR = 60.0
"""Wall time (s) for which a finished goal's id is remembered, so that a late cancel or a resent goal does not start it
again."""
REMEMBER_AT_MOST = 2000
"""Largest number of finished goals remembered; the oldest are forgotten first."""
LIST_AT_MOST = 600
"""Largest number of finished goals in the status, the newest. actionlib's client takes a goal for lost that is not in
the status while its result is still queued; for twenty clients at 20 Hz, each has 1.5 s for that."""
LONGEST_ID = 1000
"""Largest number of characters of a goal's id, which each status message repeats; actionlib's have some forty."""
HELD_BACK_FOR = 0.05
"""Wall time (s) for which nothing is published of a new goal, unless it is leased.

rospy's SimpleActionClient registers a goal a moment after it has sent it, and ignores messages on it before: of 600
goals refused at once on a busy machine, three never ended for their clients.
"""
STAMPED_BEFORE = (
    "This goal handle was canceled by the action server because its timestamp is before the timestamp of the last "
    "cancel request"
)
"""actionlib's status text for a goal older than the last cancel of all goals."""


class GoalSink(Protocol):
    """What a GoalTracker publishes to; ActionServer implements it."""

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Send a goal's result."""

    def publish_feedback(self, status: GoalStatus, feedback: Any) -> None:
        """Send feedback of a goal."""

    def status_changed(self) -> None:
        """Called when the status has changed."""


class TrackedGoal:
    """One goal at the server, with the methods of actionlib's ServerGoalHandle that are used here.

    Attributes:
        status: Its GoalStatus.
        client: Name of the node that sent it.
        has_come: Whether the goal was received, and not only its cancel.
        lapse: Why it was cancelled without a request, as its client is gone; empty where it was not.
        finished_at: Wall time (s) of its end, or of a cancel whose goal was not received; None before.
        come_at: Wall time (s) at which it was received.
        answered_at: Wall time (s) of the last renewal, or at which its client was last connected.
        is_overdue: Whether that was too long ago at the last check.
    """

    def __init__(
        self, tracker: GoalTracker, goal_id: GoalID, goal: Optional[Any], client: str, come_at: float,
    ) -> None:
        self.status = GoalStatus(goal_id=goal_id, status=PENDING)
        self.client, self.lapse = client, ""
        self.come_at = self.answered_at = come_at
        self.is_overdue = False
        self.finished_at: Optional[float] = None
        self.has_come = goal is not None
        self._tracker, self._goal = tracker, goal

    @property
    def has_ended(self) -> bool:
        """Whether its state is a terminal one."""
        return self.status.status in TERMINAL

    def get_goal(self) -> Any:
        """Return the goal message, None once it ended."""
        return self._goal

    def drop_goal(self) -> None:
        """Drop the goal message, which may be a long path."""
        self._goal = None

    def get_goal_id(self) -> GoalID:
        """Return its id."""
        return self.status.goal_id

    def set_accepted(self, text: str = "") -> None:
        """Change to ACTIVE, or to PREEMPTING where a cancel was requested."""
        self._tracker.move(self, "accept", text)

    def set_rejected(self, result: Any = None, text: str = "") -> None:
        """End it as REJECTED."""
        self._tracker.finish(self, "reject", result, text)

    def set_canceled(self, result: Any = None, text: str = "") -> None:
        """End it as PREEMPTED, or RECALLED where it was not accepted yet."""
        self._tracker.finish(self, "cancel", result, text)

    def set_aborted(self, result: Any = None, text: str = "") -> None:
        """End it as ABORTED."""
        self._tracker.finish(self, "abort", result, text)

    def set_succeeded(self, result: Any = None, text: str = "") -> None:
        """End it as SUCCEEDED."""
        self._tracker.finish(self, "succeed", result, text)

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback, unless the goal has ended."""
        self._tracker.feed_back(self, feedback)


class GoalTracker:
    """Keeps the states of goals, by goals, cancels and renewals received, and ends each goal exactly once.

    Its one lock is re-entrant; callbacks run with it held.
    """

    def __init__(
        self, sink: GoalSink, on_goal: Callable[[TrackedGoal], None], on_cancel: Callable[[TrackedGoal], None],
        empty_result: Callable[[], Any], clock: Callable[[], float], ros_now: Callable[[], Any],
        recalled: Optional[Callable[[], Any]] = None, on_overtaken: Callable[[TrackedGoal], None] = lambda goal: None,
        held_back_for: float = 0.0,
    ) -> None:
        """Begin without goals.

        Args:
            sink: Publishes status, results and feedback.
            on_goal, on_cancel: Called with each new goal, and with each goal whose cancel is requested.
            empty_result: Returns an empty result message.
            clock: Gives wall time (s).
            ros_now: Gives ROS time as genpy.Time.
            recalled: Returns the result of a goal whose cancel arrived before it. An empty one, as of actionlib, has
                outcome 0, which is SUCCESS for clients that look at the outcome alone.
            on_overtaken: Called with a goal whose cancel arrived before it, on another connection, before the goal is
                ended.
            held_back_for: See HELD_BACK_FOR; 0 to publish at once.
        """
        self.lock = threading.RLock()
        self._sink, self._on_goal, self._on_cancel, self._on_overtaken = sink, on_goal, on_cancel, on_overtaken
        self._empty_result, self._recalled = empty_result, recalled or empty_result
        self._clock, self._ros_now, self._held_back_for = clock, ros_now, held_back_for
        self._goals: Dict[str, TrackedGoal] = {}  # oldest first
        self._bygone: Dict[str, float] = {}  # wall time of the end, by id, of goals no longer in _goals; oldest first
        self._held_back: Dict[TrackedGoal, List[Callable[[], None]]] = {}  # of new goals, what is to be published
        self._last_cancel = Time()
        self._used_id = ""  # the last one there was a warning of
        self._numbers = itertools.count(1)

    # what arrives

    def take_goal(self, goal_id: GoalID, goal: Any, client: str = "") -> None:
        """Take a goal message: hand it on, unless its id is known already or its cancel came before it.

        Args:
            goal_id: Its id; where the id or the stamp is empty, it gets one here.
            goal: The goal message.
            client: Name of the node that sent it.
        """
        if _is_too_long(goal_id):
            return
        with self.lock:
            now, stamp = self._ros_now(), goal_id.stamp
            name = goal_id.id or f"{client}-unnamed-{next(self._numbers)}-{now.to_sec():.3f}"
            known = self._goals.get(name)
            ended_at = known.finished_at if known is not None and known.has_ended else self._bygone.get(name)
            if ended_at is not None:
                self._warn_of_used_id(name, ended_at)
                return
            if known is not None and known.has_come:
                return
            tracked = TrackedGoal(self, GoalID(stamp=stamp or now, id=name), goal, client, self._clock())
            self._goals[name] = tracked
            if known is None:
                self._hand_on(tracked, stamp, now)
            else:  # its cancel came before it
                tracked.status.status = RECALLING
                self._on_overtaken(tracked)
                tracked.set_canceled(self._recalled(), known.status.text)

    def _hand_on(self, tracked: TrackedGoal, stamp: Time, now: Time) -> None:
        """Hand on a new goal, or end it where all goals up to its stamp were cancelled.

        Args:
            tracked: The goal.
            stamp: The stamp its message had; 0 may be a missing one, or a simulation's first time.
            now: ROS time.
        """
        if self._held_back_for and not is_leased(tracked.get_goal_id().id):
            self._held_back[tracked] = []
        if self._last_cancel > now:
            self._last_cancel = Time()  # the clock was set back since, and else every goal would be older
        if stamp and stamp <= self._last_cancel:
            tracked.set_canceled(self._recalled(), STAMPED_BEFORE)
        else:
            self._on_goal(tracked)
            self._status_changed(tracked)

    def take_cancel(self, goal_id: GoalID) -> None:
        """Take a cancel message, by actionlib's rules: of one goal, of all up to a time, or of all."""
        if _is_too_long(goal_id):
            return
        with self.lock:
            named = self._goals.get(goal_id.id)
            if named is not None and named in self._held_back:  # else its client takes it for lost
                self._release(named)
            for tracked in list(self._goals.values()):
                if _is_meant(tracked.get_goal_id(), goal_id):
                    self._request_cancel(tracked)
            if goal_id.id and named is None and goal_id.id not in self._bygone:  # the cancel came before its goal
                early = self._goals[goal_id.id] = TrackedGoal(self, goal_id, None, "", self._clock())
                early.status.status, early.finished_at = RECALLING, early.come_at
                self._sink.status_changed()
            self._last_cancel = max(self._last_cancel, goal_id.stamp)

    def renew(self, goal_id: str) -> None:
        """Take the renewal of a goal's lease."""
        tracked = self._goals.get(goal_id)
        if tracked is not None:
            tracked.answered_at = self._clock()

    # what goals do

    def move(self, tracked: TrackedGoal, event: str, text: str) -> bool:
        """Change a goal's state by an event of TRANSITIONS; return whether its state allowed that."""
        with self.lock:
            state = TRANSITIONS[event].get(tracked.status.status)
            if state is None:
                logging.getLogger("rosout").error(
                    "goal %s cannot %s in state %d", tracked.status.goal_id.id, event, tracked.status.status)
                return False
            tracked.status.status, tracked.status.text = state, text
            self._status_changed(tracked)
            return True

    def finish(self, tracked: TrackedGoal, event: str, result: Any, text: str) -> None:
        """End a goal and publish its result."""
        with self.lock:
            if self.move(tracked, event, text):
                tracked.finished_at = self._clock()
                tracked.drop_goal()
                result = self._empty_result() if result is None else result
                self._publish(tracked, lambda: self._sink.publish_result(tracked.status, result))

    def feed_back(self, tracked: TrackedGoal, feedback: Any) -> None:
        """Publish feedback of a goal that has not ended."""
        with self.lock:
            if not tracked.has_ended:
                self._publish(tracked, lambda: self._sink.publish_feedback(tracked.status, feedback))

    # the passing of time

    def update(self, connected: Optional[Callable[[str], bool]] = None, client_timeout: float = 0.0) -> None:
        """Forget goals that ended long ago, and cancel goals whose client is gone; call a few times a second.

        A goal is cancelled where it is overdue at two calls in a row: between them, renewals are read that arrived
        while the server itself was stopped or got no CPU time.

        Args:
            connected: Returns whether a node, by name, is connected; that counts for goals without a lease.
            client_timeout: Wall time (s) after which such goals of a disconnected client are cancelled; 0 for never.
        """
        with self.lock:
            now = self._clock()
            self.release(now - self._held_back_for)
            self._forget(now)
            for goal_id, tracked in list(self._goals.items()):
                if not tracked.has_come or tracked.status.status not in (PENDING, ACTIVE):
                    continue  # it has ended or is being cancelled
                if is_leased(goal_id):
                    patience, gone = DURATION, f"has not renewed it for {DURATION:g} s"
                elif client_timeout > 0.0 and connected is not None:
                    patience, gone = client_timeout, "is not connected any more"
                    if connected(tracked.client):
                        tracked.answered_at = now
                else:
                    continue
                was_overdue, tracked.is_overdue = tracked.is_overdue, now - tracked.answered_at >= patience
                if was_overdue and tracked.is_overdue:
                    tracked.lapse = f"ended because its client {tracked.client or 'of no name'} {gone}"
                    self._request_cancel(tracked)

    def release(self, until: float = math.inf) -> None:
        """Publish what was held back (see HELD_BACK_FOR) of goals received up to a wall time (s)."""
        with self.lock:
            while self._held_back:
                oldest = next(iter(self._held_back))
                if oldest.come_at > until:
                    return
                self._release(oldest)

    def listed(self) -> List[GoalStatus]:
        """Return the contents of the status message: all goals that have not ended, and those that ended lately."""
        with self.lock:
            since, statuses, room = self._clock() - LIST_FOR, [], LIST_AT_MOST
            for tracked in reversed(list(self._goals.values())):
                if tracked in self._held_back:
                    continue
                if tracked.finished_at is None:
                    statuses.append(tracked.status)
                elif tracked.finished_at >= since and room > 0:
                    room -= 1
                    statuses.append(tracked.status)
            return statuses[::-1]

    def _request_cancel(self, tracked: TrackedGoal) -> None:
        state = TRANSITIONS["request cancel"].get(tracked.status.status)
        if state is not None:
            tracked.status.status = state
            self._status_changed(tracked)
            self._on_cancel(tracked)

    def _warn_of_used_id(self, name: str, ended_at: float) -> None:
        """Warn, once, of a goal refused because its id was used before, as by a client with constant ids.

        Not of leased goals, which clients resend when an acknowledgement is late.
        """
        if name != self._used_id and not is_leased(name):
            self._used_id = name
            logging.getLogger("rosout").warning(
                "refused a goal by the id '%s', which one had that ended %.0f s ago; give each its own, or none",
                name, self._clock() - ended_at)

    def _release(self, tracked: TrackedGoal) -> None:
        for publication in self._held_back.pop(tracked):
            publication()
        self._sink.status_changed()

    def _publish(self, tracked: TrackedGoal, publication: Callable[[], None]) -> None:
        if tracked in self._held_back:
            self._held_back[tracked].append(publication)
        else:
            publication()

    def _status_changed(self, tracked: TrackedGoal) -> None:
        if tracked not in self._held_back:
            self._sink.status_changed()

    def _forget(self, now: float) -> None:
        """Keep only ids of goals that the status no longer lists, and forget these in the end."""
        for name, goal in list(self._goals.items()):
            if goal.finished_at is not None and now - goal.finished_at > LIST_FOR:
                if goal.has_ended:
                    del self._goals[name]
                    self._bygone[name] = goal.finished_at
                elif now - goal.finished_at > REMEMBER_FOR:
                    del self._goals[name]  # a cancel whose goal never came
        finished = [name for name, goal in self._goals.items() if goal.finished_at is not None]
        while self._bygone:
            name, finished_at = next(iter(self._bygone.items()))
            if len(self._bygone) + len(finished) <= REMEMBER_AT_MOST and now - finished_at <= REMEMBER_FOR:
                break
            del self._bygone[name]
        for name in finished[:max(0, len(finished) - REMEMBER_AT_MOST)]:
            del self._goals[name]


def _is_too_long(goal_id: GoalID) -> bool:
    """Return whether an id is longer than LONGEST_ID, and log an error if so; the goal is ignored then."""
    too_long = len(goal_id.id) > LONGEST_ID
    if too_long:
        logging.getLogger("rosout").error(
            "refused a goal, or its cancel, whose id has %d characters; at most %d allowed: '%s...'",
            len(goal_id.id), LONGEST_ID, goal_id.id[:40])
    return too_long


def _is_meant(goal_id: GoalID, cancel: GoalID) -> bool:
    """Return whether a cancel is of a goal: the one with its id, one up to its stamp, or, where it has neither, any."""
    if not cancel.id and not cancel.stamp:
        return True
    return bool(goal_id.id == cancel.id or (cancel.stamp and goal_id.stamp <= cancel.stamp))
