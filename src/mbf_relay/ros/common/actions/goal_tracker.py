"""The goals of an action server, held to actionlib's transitions by one table; neither topics nor threads.

This stands in for the bookkeeping of actionlib's ActionServer, which lets a finished goal begin anew (a cancel, its
goal and the cancel again), forgets on the ROS clock, which may stand or be set back, and cannot tell that a client is
gone.
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
"""actionlib's: what may happen to a goal, in which states, and where it leads (actionlib/DetailedDescription)."""
TERMINAL: FrozenSet[int] = frozenset((PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED))

LIST_FOR = 5.0
"""Wall time (s) for which the status tells of a finished goal, or of a cancel without its goal: actionlib's default."""
REMEMBER_FOR = 60.0
"""Wall time (s) for which it is remembered, so that neither a late cancel nor the goal sent again begins it anew."""
REMEMBER_AT_MOST = 2000
"""Number of finished goals remembered, the oldest of which are forgotten first."""
LIST_AT_MOST = 600
"""Number of finished goals in the status, the newest. A client of actionlib's takes a goal for lost that ended and is
not in the status when its result still waits to be looked at; of twenty clients at 20 Hz, each has 1.5 s for that."""
LONGEST_ID = 1000
"""Characters of a goal's id at most: the status repeats each five times a second. actionlib's have some forty."""
FIRST_WORD = 0.05
"""Wall time (s) after which a goal of a client without leases is spoken of at all.

rospy's SimpleActionClient knows a goal as its own only a moment after it has sent it, and drops what it hears of it
before: of 600 goals refused at once on a busy machine, three never ended for whoever waited for them.
"""
STAMPED_BEFORE = (
    "This goal handle was canceled by the action server because its timestamp is before the timestamp of the last "
    "cancel request"
)
"""actionlib's text."""


class GoalSink(Protocol):
    """Where a tracker's words go."""

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Send a goal's result."""

    def publish_feedback(self, status: GoalStatus, feedback: Any) -> None:
        """Send feedback of a goal."""

    def status_changed(self) -> None:
        """Note that the status is not what it was."""


class TrackedGoal:
    """One goal at the server, with those methods of actionlib's ServerGoalHandle that are used.

    Attributes:
        status: Its GoalStatus.
        client: Name of the node that sent it.
        has_come: Whether the goal is there, and not its cancel alone.
        lapse: Why it was cancelled though nobody asked for that, its client being gone; empty where it was not.
        finished_at: Wall time (s) of its end, or of a cancel whose goal has not come; None before.
        come_at: Wall time (s) at which it came.
        answered_at: Wall time (s) at which its client was last seen to answer for it.
        is_overdue: Whether that was too long ago at the last look.
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
        """Let go of the message, which may be a long path."""
        self._goal = None

    def get_goal_id(self) -> GoalID:
        """Return its id."""
        return self.status.goal_id

    def set_accepted(self, text: str = "") -> None:
        """Go over to ACTIVE, or to PREEMPTING where a cancel came before."""
        self._tracker.move(self, "accept", text)

    def set_rejected(self, result: Any = None, text: str = "") -> None:
        """End it as refused."""
        self._tracker.finish(self, "reject", result, text)

    def set_canceled(self, result: Any = None, text: str = "") -> None:
        """End it as called off."""
        self._tracker.finish(self, "cancel", result, text)

    def set_aborted(self, result: Any = None, text: str = "") -> None:
        """End it as failed."""
        self._tracker.finish(self, "abort", result, text)

    def set_succeeded(self, result: Any = None, text: str = "") -> None:
        """End it as reached."""
        self._tracker.finish(self, "succeed", result, text)

    def publish_feedback(self, feedback: Any) -> None:
        """Send feedback, unless it ended."""
        self._tracker.feed_back(self, feedback)


class GoalTracker:
    """Takes goals, cancels and renewals as they arrive, and gives each goal one end.

    One lock, re-entrant: the callbacks run under it, goals take it.
    """

    def __init__(
        self, sink: GoalSink, on_goal: Callable[[TrackedGoal], None], on_cancel: Callable[[TrackedGoal], None],
        empty_result: Callable[[], Any], clock: Callable[[], float], ros_now: Callable[[], Any],
        recalled: Optional[Callable[[], Any]] = None, on_overtaken: Callable[[TrackedGoal], None] = lambda goal: None,
        first_word: float = 0.0,
    ) -> None:
        """Begin without goals.

        Args:
            sink: Where status, results and feedback go.
            on_goal, on_cancel: Called with each new goal, and with each goal of which a cancel is to be heard.
            empty_result: Makes a result that says nothing.
            clock: Gives wall time (s).
            ros_now: Gives ROS time, as a message has it.
            recalled: Makes the result of a goal whose cancel came before it; actionlib's empty one says 0, which is
                SUCCESS to whoever looks at the outcome alone.
            on_overtaken: Called with a goal whose cancel came before it, before that goal ends: the two come by
                connections of their own.
            first_word: See FIRST_WORD; 0 for at once.
        """
        self.lock = threading.RLock()
        self._sink, self._on_goal, self._on_cancel, self._on_overtaken = sink, on_goal, on_cancel, on_overtaken
        self._empty_result, self._recalled = empty_result, recalled or empty_result
        self._clock, self._ros_now, self._first_word = clock, ros_now, first_word
        self._goals: Dict[str, TrackedGoal] = {}  # oldest first
        self._bygone: Dict[str, float] = {}  # when goals finished of which nothing else is known any more, oldest first
        self._unsaid: Dict[TrackedGoal, List[Callable[[], None]]] = {}  # not spoken of yet, and what is to be said
        self._last_cancel = Time()
        self._used_id = ""  # that was last told of
        self._numbers = itertools.count(1)

    # what arrives

    def take_goal(self, goal_id: GoalID, goal: Any, client: str = "") -> None:
        """Take a goal message; one that is known already changes nothing.

        Args:
            goal_id: Its id; given one here where it is empty.
            goal: The goal.
            client: Name of the node it came from.
        """
        if _is_too_long(goal_id):
            return
        with self.lock:
            now, stamp = self._ros_now(), goal_id.stamp
            goal_id = GoalID(
                stamp=stamp or now,
                id=goal_id.id or f"{client}-unnamed-{next(self._numbers)}-{now.to_sec():.3f}",
            )
            known = self._goals.get(goal_id.id)
            ended_at = self._bygone.get(goal_id.id) if known is None else known.finished_at
            if ended_at is not None and (known is None or known.has_ended):
                self._tell_of_used_id(goal_id.id, ended_at)
                return
            if known is not None and known.has_come:
                return
            tracked = self._goals[goal_id.id] = TrackedGoal(self, goal_id, goal, client, self._clock())
            if self._first_word and known is None and not is_leased(goal_id.id):
                self._unsaid[tracked] = []
            if known is not None:
                tracked.status.status = RECALLING
                self._on_overtaken(tracked)
                tracked.set_canceled(self._recalled(), known.status.text)
                return
            if self._last_cancel > now:
                self._last_cancel = Time()  # the clock was set back since, and else every goal would be older
            if stamp and stamp <= self._last_cancel:  # none says nothing of age; it is also a simulation's first
                tracked.set_canceled(self._recalled(), STAMPED_BEFORE)
            else:
                self._on_goal(tracked)
                self._tell_change(tracked)

    def take_cancel(self, goal_id: GoalID) -> None:
        """Take a cancel message: of one goal, of all up to a time, or of all."""
        if _is_too_long(goal_id):
            return
        with self.lock:
            named = self._goals.get(goal_id.id)
            if named is not None and named in self._unsaid:  # its client takes it for lost where the status lacks it
                self._speak_of(named)
            everything = not goal_id.id and not goal_id.stamp
            for tracked in list(self._goals.values()):
                until = bool(goal_id.stamp) and tracked.status.goal_id.stamp <= goal_id.stamp
                if everything or until or tracked.status.goal_id.id == goal_id.id:
                    self._request_cancel(tracked)
            if goal_id.id and goal_id.id not in self._goals and goal_id.id not in self._bygone:
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
        """Let something happen to a goal; return whether its state allowed that."""
        with self.lock:
            state = TRANSITIONS[event].get(tracked.status.status)
            if state is None:
                logging.getLogger("rosout").error(
                    "goal %s cannot %s in state %d", tracked.status.goal_id.id, event, tracked.status.status)
                return False
            tracked.status.status, tracked.status.text = state, text
            self._tell_change(tracked)
            return True

    def finish(self, tracked: TrackedGoal, event: str, result: Any, text: str) -> None:
        """End a goal and send its result."""
        with self.lock:
            if self.move(tracked, event, text):
                tracked.finished_at = self._clock()
                tracked.drop_goal()
                result = self._empty_result() if result is None else result
                self._say(tracked, lambda: self._sink.publish_result(tracked.status, result))

    def feed_back(self, tracked: TrackedGoal, feedback: Any) -> None:
        """Send feedback of a goal that has not ended."""
        with self.lock:
            if not tracked.has_ended:
                self._say(tracked, lambda: self._sink.publish_feedback(tracked.status, feedback))

    # the passing of time

    def look(self, connected: Optional[Callable[[str], bool]] = None, client_timeout: float = 0.0) -> None:
        """Forget what ended long ago, and cancel what nobody answers for; call a few times a second.

        A goal is overdue at two looks in a row before it is cancelled: between them renewals are read that had come
        while the whole server stood still, or was given hardly any processor.

        Args:
            connected: Tells whether the node of that name is connected, which renews its goals without a lease.
            client_timeout: Wall time (s) after which such goals of a client that is not connected end; 0 for never.
        """
        with self.lock:
            now = self._clock()
            self.speak(now - self._first_word)
            self._forget(now)
            for goal_id, tracked in list(self._goals.items()):
                if not tracked.has_come or tracked.status.status not in (PENDING, ACTIVE):
                    continue  # it ended, or a cancel is heard already
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

    def speak(self, until: float = math.inf) -> None:
        """Tell of the goals that came up to a wall time (s) and were not spoken of yet."""
        with self.lock:
            while self._unsaid:
                tracked = next(iter(self._unsaid))
                if tracked.come_at > until:
                    return
                self._speak_of(tracked)

    def listed(self) -> List[GoalStatus]:
        """Return what the status tells: every goal that has not ended, and those that ended lately."""
        with self.lock:
            since, statuses, room = self._clock() - LIST_FOR, [], LIST_AT_MOST
            for tracked in reversed(list(self._goals.values())):
                if tracked in self._unsaid:
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
            self._tell_change(tracked)
            self._on_cancel(tracked)

    def _tell_of_used_id(self, name: str, ended_at: float) -> None:
        """Say, once, that a goal is not taken whose id one had before, as of somebody who writes them by hand.

        Who leases goals sends one again that was not acknowledged in time.
        """
        if name != self._used_id and not is_leased(name):
            self._used_id = name
            logging.getLogger("rosout").warning(
                "refused a goal by the id '%s', which one had that ended %.0f s ago; give each its own, or none",
                name, self._clock() - ended_at)

    def _speak_of(self, tracked: TrackedGoal) -> None:
        for word in self._unsaid.pop(tracked):
            word()
        self._sink.status_changed()

    def _say(self, tracked: TrackedGoal, word: Callable[[], None]) -> None:
        if tracked in self._unsaid:
            self._unsaid[tracked].append(word)
        else:
            word()

    def _tell_change(self, tracked: TrackedGoal) -> None:
        if tracked not in self._unsaid:
            self._sink.status_changed()

    def _forget(self, now: float) -> None:
        """Keep of what the status does not tell of any more only the name, and that not for ever."""
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
    """Return whether an id is no name but a burden, and say so; its goal is not taken, and nobody can wait for it."""
    too_long = len(goal_id.id) > LONGEST_ID
    if too_long:
        logging.getLogger("rosout").error(
            "refused a goal, or its cancel, whose id has %d characters; at most %d allowed: '%s...'",
            len(goal_id.id), LONGEST_ID, goal_id.id[:40])
    return too_long
