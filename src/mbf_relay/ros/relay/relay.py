"""The relay's core: move_base's goals, carried out by a Move Base Flex server.

It pursues one goal at a time, as move_base does. What the goal's client sees:

    goal arrives ----------> ACTIVE --- the server ends it ------------> SUCCEEDED or ABORTED
      |  |                     |------- a newer goal arrives ----------> PREEMPTED, at once
      |  |                     |------- no server in `server_timeout` -> ABORTED
      |  |                     |------- the server dies ---------------> ABORTED
      |  |                     |------- its quaternion is none --------> ABORTED, at once
      |  |                     `-- cancel --> PREEMPTING -- the server ends it --> PREEMPTED (or what came first)
      |  `-- not finite: ABORTED, and what runs goes on
      `-- older than the newest goal seen, or called off before it came ----------> RECALLED

What the server is asked follows from two things alone: the goal pursued, and the goals sent that have not ended there.

- The server replaces a running goal when the next one comes, without stopping the robot. So a replaced goal is not
  cancelled, but neither forgotten: until the server has ended it, it may be what the robot drives for.
- Where no goal is pursued, or the one that is was cancelled, every goal sent is cancelled, again and again until it
  ends.
- A goal waits while a cancel is under way, because a late one would hit it in servers that cancel whatever runs.
- When the last goal sent has ended, however it did, the robot is told to stand, as move_base tells it.

Nothing here knows topics: goals, the server's client and an observer are handed in.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, ContextManager, List, Optional, Protocol

from actionlib_msgs.msg import GoalID
from move_base_msgs.msg import MoveBaseFeedback, MoveBaseGoal

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.ros.common.actions.client_goals import RESEND_AFTER, ActionEnding
from mbf_relay.ros.relay import answers
from mbf_relay.ros.relay.answers import Answer

CANCEL_REPEATED_AFTER = 1.0
"""Wall time (s) without an answer after which a cancel is sent again."""
ZERO_REPEATED_AFTER = 0.05
"""Wall time (s) after which zero velocity is sent once more: what the server sent last may be on its way for longer
than its answer, and what is sent in one moment gets lost together."""
SUCCESSOR_PATIENCE = 2.0
"""Wall time (s) a goal waits for the end of a cancelled predecessor."""


@dataclass(frozen=True)
class RelayParameters(ParameterSet):
    """Parameters of the relay itself; move_base's own are MoveBaseParameters."""

    server: str = parameter("move_base_flex", "name of the Move Base Flex node")
    server_timeout: float = parameter(20.0, "how long a goal waits for an absent server", unit="s", minimum=0.0)
    silence_timeout: float = parameter(
        0.7, "time without a message after which a connected server counts as hung", unit="s", above=0.0)
    service_timeout: float = parameter(
        5.0, "how long a service call waits for a server that is running", unit="s", above=0.0)
    cancel_timeout: float = parameter(
        20.0, "how long a cancelled goal waits for the server to end it", unit="s", above=0.0)
    arrival_tolerance: float = parameter(
        0.5, "distance to the goal, by the server's own report, above which its success is not accepted", unit="m",
        above=0.0)
    stop_on_server_loss: bool = parameter(
        True, "send zero velocity when a goal ends and no other follows, also if the server was lost")
    global_frame: str = parameter("map", "frame of ~current_goal", is_frame=True)

    @property
    def acknowledge_timeout(self) -> float:
        """How long (s) a server that is there may take to tell of a goal, which may get lost and be sent again."""
        return max(self.server_timeout, 3.0 * RESEND_AFTER)


class ClientGoal(Protocol):
    """A client's goal; the methods of actionlib's ServerGoalHandle that the relay uses."""

    def get_goal(self) -> MoveBaseGoal:
        """Return the goal."""

    def get_goal_id(self) -> GoalID:
        """Return its id and stamp."""

    def set_accepted(self, text: str = "") -> None:
        """Go over to ACTIVE."""

    def set_canceled(self, result: Any = None, text: str = "") -> None:
        """End it PREEMPTED, or RECALLED where it was not accepted."""

    def set_aborted(self, result: Any = None, text: str = "") -> None:
        """End it ABORTED."""

    def set_succeeded(self, result: Any = None, text: str = "") -> None:
        """End it SUCCEEDED."""

    def publish_feedback(self, feedback: MoveBaseFeedback) -> None:
        """Tell the client where the robot is."""


class ServerGoal(Protocol):
    """A goal at the server."""

    def cancel(self) -> None:
        """Ask the server to cancel it."""


class ServerClient(Protocol):
    """The way to the server."""

    @property
    def server_is_up(self) -> bool:
        """Whether a goal sent now will arrive."""

    def send(
        self, goal: Any, on_feedback: Callable[[Any], None], on_end: Callable[[ActionEnding], None]
    ) -> ServerGoal:
        """Send a goal; each callback may come before this has returned."""


class Observer:
    """Told what the relay does besides answering its clients; does nothing by itself."""

    def goal_taken(self, pose: Any) -> None:
        """Note that a goal is pursued from now on; `pose` is its PoseStamped."""

    def goal_ended(self, client_goal: ClientGoal, answer: Answer, result: Optional[Any]) -> None:
        """Note that a goal has its answer; `result` is the server's result message where there is one."""

    def robot_seen(self, pose: Any) -> None:
        """Note that the server said where the robot is; `pose` is a PoseStamped."""

    def stop_robot(self) -> None:
        """Have the robot stand: nothing is left that it drives for."""


class Relay:
    """Takes goals and cancels from move_base's side, asks the server, and answers.

    Every method may be called from any thread. The one lock is the action server's own, because goal callbacks already
    hold it and goals take it.
    """

    def __init__(
        self, server: ServerClient, compose: Callable[[Any], Any], parameters: RelayParameters, observer: Observer,
        lock: Optional[ContextManager[Any]] = None, clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a relay that pursues nothing.

        Args:
            server: A client of the server's move_base action.
            compose: Makes the server's goal message of a PoseStamped; must not wait for anybody.
            parameters: Timeouts.
            observer: Told what happens.
            lock: Re-entrant; the action server's where there is one.
            clock: Gives wall time (s).
        """
        self._server, self._compose = server, compose
        self._parameters, self._observer = parameters, observer
        self._lock, self._clock = lock or threading.RLock(), clock
        self._current: Optional[_ActiveGoal] = None
        self._at_server: List[_SentGoal] = []  # oldest first
        self._zero_due_at = math.inf
        self._newest_stamp = 0.0
        self._over: Optional[Answer] = None  # to every goal, once this node ends

    def take_goal(self, client_goal: ClientGoal, now: float) -> None:
        """Pursue a goal in place of the present one.

        Args:
            client_goal: The goal.
            now: ROS time (s), to know a clock that was set back.
        """
        with self._lock:
            pose = client_goal.get_goal().target_pose
            if self._is_outdated(client_goal, now):
                client_goal.set_canceled(None, answers.REPLACED)
                return
            refusal = self._over or answers.not_finite(pose.pose)
            if refusal is not None:
                client_goal.set_accepted(answers.ACCEPTED)
                self._give(client_goal, refusal)
                return
            self._replace_by(client_goal)
            client_goal.set_accepted(answers.ACCEPTED)
            self._current = _ActiveGoal(client_goal, self._clock())
            self._observer.goal_taken(pose)
            if not answers.is_upright(pose.pose.orientation):
                self._end(answers.aborted(answers.INVALID_QUATERNION))
            self._advance()

    def take_overtaken(self, client_goal: ClientGoal, now: float) -> None:
        """Let a goal that was called off before it came end what it was sent to replace: its client means to stand.

        Which of the two comes first is chance, and must not decide whether the robot drives on.

        Args:
            client_goal: The goal.
            now: ROS time (s), to know a clock that was set back.
        """
        with self._lock:
            pose = client_goal.get_goal().target_pose
            if not self._is_outdated(client_goal, now) and answers.not_finite(pose.pose) is None:
                self._replace_by(client_goal)
                self._advance()

    def take_cancel(self, client_goal: ClientGoal) -> None:
        """Cancel a goal, if it is the one pursued; any other has its answer already."""
        with self._lock:
            active = self._current
            if active is None or active.client_goal.get_goal_id().id != client_goal.get_goal_id().id:
                return
            active.cancelled_at = self._clock()
            if active.sent is None:
                self._end(answers.preempted())
            self._advance()

    def check(self) -> None:
        """Let time pass: give up waiting where it took too long. Call a few times a second."""
        with self._lock:
            active, now = self._current, self._clock()
            if now >= self._zero_due_at:
                self._zero_due_at = math.inf
                self._observer.stop_robot()
            if active is not None:
                self._lose_patience(active, now)
            for sent in list(self._at_server):
                if sent.is_given_up(now, self._parameters.cancel_timeout) and not sent.cancel_is_under_way(now):
                    self._leave(sent)
            self._advance()

    def shut_down(self) -> None:
        """Cancel at the server and abort, because this node ends; so it does with goals that still come."""
        with self._lock:
            self._over = answers.aborted(answers.NODE_KILLED)
            self._end(self._over)
            self._advance()

    @property
    def is_pursuing(self) -> bool:
        """Whether there is a goal without its answer."""
        return self._current is not None

    def _is_outdated(self, client_goal: ClientGoal, now: float) -> bool:
        """Return whether a newer goal came before; one dated ahead of `now` is of before the clock was set back."""
        return bool(client_goal.get_goal_id().stamp.to_sec() < self._newest_stamp <= now)

    def _replace_by(self, client_goal: ClientGoal) -> None:
        """End the goal pursued, if there is one, because this newer one has come."""
        self._newest_stamp = client_goal.get_goal_id().stamp.to_sec()
        self._end(answers.preempted(answers.REPLACED))

    def _lose_patience(self, active: _ActiveGoal, now: float) -> None:
        """End a goal that has waited too long for a server, or for the server's answer to its cancel."""
        parameters = self._parameters
        if active.sent is None and now - active.waits_since > parameters.server_timeout:
            if not self._server.server_is_up:  # else it waits for a predecessor's end, and not for long
                self._end(answers.server_absent(parameters))
        elif active.cancelled_at is not None and now - active.cancelled_at > parameters.cancel_timeout:
            self._end(answers.preempted(reason="the server did not answer the cancel"))

    def _advance(self) -> None:
        """Do what follows from the goal pursued and the goals at the server: cancel them, send it, or neither."""
        active, now = self._current, self._clock()
        if active is None or active.cancelled_at is not None:
            for sent in list(self._at_server):
                if not sent.is_given_up(now, self._parameters.cancel_timeout):
                    sent.press_cancel(now)
        elif active.sent is None and self._server.server_is_up:
            if not any(sent.cancel_is_under_way(now) for sent in self._at_server):
                self._send(active)

    def _send(self, active: _ActiveGoal) -> None:
        sent = active.sent = _SentGoal()
        self._at_server.append(sent)  # before it is sent: its ending may come before `send` has returned
        self._zero_due_at = math.inf
        sent.goal = self._server.send(
            self._compose(active.client_goal.get_goal().target_pose),
            on_feedback=lambda feedback: self._take_feedback(sent, feedback),
            on_end=lambda ending: self._take_ending(sent, ending),
        )

    def _take_feedback(self, sent: _SentGoal, feedback: Any) -> None:
        with self._lock:
            active = self._current
            if active is not None and sent is active.sent:
                self._observer.robot_seen(feedback.current_pose)
                active.client_goal.publish_feedback(MoveBaseFeedback(base_position=feedback.current_pose))

    def _take_ending(self, sent: _SentGoal, ending: ActionEnding) -> None:
        with self._lock:
            active = self._current
            self._leave(sent)
            if active is not None and sent is active.sent:
                target, cancelled = active.client_goal.get_goal().target_pose, active.cancelled_at is not None
                doubt = answers.doubt_of_arrival(ending, target, self._parameters.arrival_tolerance)
                if not doubt:
                    self._end(answers.answer_to(ending, cancelled), ending.result)
                elif active.was_doubted or cancelled:
                    self._end(answers.not_arrived(doubt, cancelled))
                else:
                    # The C++ server credits a new goal with the arrival of the one it replaced. Sent once more, the
                    # goal replaces none, and what the server claims then is this goal's own.
                    active.was_doubted, active.sent, active.waits_since = True, None, self._clock()
            self._advance()

    def _leave(self, sent: _SentGoal) -> None:
        """Note that a goal has ended at the server, or was given up; where it was the last, have the robot stand.

        One that was given up, and so left before, may still end: until then the robot may have driven for it.
        """
        if sent in self._at_server:
            self._at_server.remove(sent)
        if not self._at_server:
            self._zero_due_at = self._clock() + ZERO_REPEATED_AFTER
            self._observer.stop_robot()

    def _end(self, answer: Answer, result: Optional[Any] = None) -> None:
        """Give the goal pursued its one terminal state, if there is one."""
        if self._current is not None:
            active, self._current = self._current, None
            self._give(active.client_goal, answer, result)

    def _give(self, client_goal: ClientGoal, answer: Answer, result: Optional[Any] = None) -> None:
        answer.give(client_goal)
        self._observer.goal_ended(client_goal, answer, result)


class _ActiveGoal:
    """The client's goal that is pursued.

    Attributes:
        client_goal: Where its answer goes.
        waits_since: When it came, or was to be sent once more (s).
        sent: The server's goal that was sent for it, None before.
        cancelled_at: When the client cancelled it (s), None before.
        was_doubted: Whether the server has claimed an arrival once already that was not believed.
    """

    def __init__(self, client_goal: ClientGoal, now: float) -> None:
        self.client_goal, self.waits_since = client_goal, now
        self.sent: Optional[_SentGoal] = None
        self.cancelled_at: Optional[float] = None
        self.was_doubted = False


class _SentGoal:
    """A goal sent to the server, where it has not ended, and what was done to cancel it.

    Attributes:
        goal: To cancel it by; None until the client of the server has returned from sending it.
        first_cancel_at: When its cancel was sent for the first time (s), None before.
    """

    def __init__(self) -> None:
        self.goal: Optional[ServerGoal] = None
        self.first_cancel_at: Optional[float] = None
        self._last_cancel_at = -math.inf

    def press_cancel(self, now: float) -> None:
        """Send its cancel, and again where the server has not answered the last one for long."""
        if self.goal is None or now - self._last_cancel_at <= CANCEL_REPEATED_AFTER:
            return
        self._last_cancel_at = now
        if self.first_cancel_at is None:
            self.first_cancel_at = now
        self.goal.cancel()

    def is_given_up(self, now: float, timeout: float) -> bool:
        """Return whether its first cancel is more than `timeout` seconds old: no further one is sent then."""
        return self.first_cancel_at is not None and now - self.first_cancel_at > timeout

    def cancel_is_under_way(self, now: float) -> bool:
        """Return whether its last cancel is so young that the server may still act on it."""
        return now - self._last_cancel_at < SUCCESSOR_PATIENCE
