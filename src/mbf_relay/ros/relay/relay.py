"""The relay's core: move_base's goals, carried out by a Move Base Flex server.

It carries out one goal at a time, as move_base does. States that the goal's client sees:

    goal arrives ----------> ACTIVE --- the server ends it ------------> SUCCEEDED or ABORTED
      |  |                     |------- a newer goal arrives ----------> PREEMPTED, at once
      |  |                     |------- no server in `server_timeout` -> ABORTED
      |  |                     |------- the server dies ---------------> ABORTED
      |  |                     |------- its quaternion is no yaw ------> ABORTED, at once
      |  |                     `-- cancel --> PREEMPTING -- the server ends it --> PREEMPTED (or what came first)
      |  `-- not finite: ABORTED, and what runs goes on
      `-- older than the newest goal seen, or cancelled before it came -----------> RECALLED

What is sent to the server depends only on the current goal and on the goals sent that have not ended there yet.

- The server replaces a running goal by the next one without stopping the robot. A replaced goal is therefore not
  cancelled, but kept in the list until the server has ended it, since the robot may still drive for it.
- Without a current goal, or once it is cancelled, all goals at the server are cancelled, repeatedly until they end.
- A new goal waits while a cancel is under way, since some servers cancel whatever runs when a late cancel arrives.
- When the last goal at the server has ended, in any way, a zero velocity is sent, as move_base does.

There are no topics in this module: goals, the client of the server and an observer are arguments.
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
"""Wall time (s) after which the zero velocity is sent once more: the server's last velocity may arrive later than its
result, and the first zero may get lost."""
SUCCESSOR_PATIENCE = 2.0
"""Wall time (s) that a goal waits for a cancelled predecessor to end."""


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
        """Wall time (s) a connected server has to list a goal in its status; a goal may get lost and is sent again."""
        return max(self.server_timeout, 3.0 * RESEND_AFTER)


class ClientGoal(Protocol):
    """A client's goal; the methods of actionlib's ServerGoalHandle that the relay uses."""

    def get_goal(self) -> MoveBaseGoal:
        """Return the goal."""

    def get_goal_id(self) -> GoalID:
        """Return its id and stamp."""

    def set_accepted(self, text: str = "") -> None:
        """Set the state ACTIVE."""

    def set_canceled(self, result: Any = None, text: str = "") -> None:
        """End it PREEMPTED, or RECALLED if it was not accepted."""

    def set_aborted(self, result: Any = None, text: str = "") -> None:
        """End it ABORTED."""

    def set_succeeded(self, result: Any = None, text: str = "") -> None:
        """End it SUCCEEDED."""

    def publish_feedback(self, feedback: MoveBaseFeedback) -> None:
        """Send the robot's pose to the client."""


class ServerGoal(Protocol):
    """A goal at the server."""

    def cancel(self) -> None:
        """Ask the server to cancel it."""


class ServerClient(Protocol):
    """Client of the server's move_base action."""

    @property
    def server_is_up(self) -> bool:
        """Whether the server is there, so that a goal can be sent."""

    def send(
        self, goal: Any, on_feedback: Callable[[Any], None], on_end: Callable[[ActionEnding], None]
    ) -> ServerGoal:
        """Send a goal; the callbacks may be called before this returns."""


class Observer:
    """Hooks for what the relay does besides answering its clients; here they do nothing."""

    def goal_taken(self, pose: Any) -> None:
        """Called when a goal becomes the current one; `pose` is its PoseStamped."""

    def goal_ended(self, client_goal: ClientGoal, answer: Answer, result: Optional[Any]) -> None:
        """Called when a goal has ended; `result` is the server's result message, None where there is none."""

    def robot_seen(self, pose: Any) -> None:
        """Called with the robot's pose (PoseStamped) from the server's feedback."""

    def stop_robot(self) -> None:
        """Called to stop the robot: no goal is left at the server."""


class Relay:
    """Takes goals and cancels of move_base's clients, has the server carry them out, and answers the clients.

    All methods may be called from any thread. The only lock is the action server's, which is held during goal callbacks
    and taken by methods of goals.
    """

    def __init__(
        self, server: ServerClient, compose: Callable[[Any], Any], parameters: RelayParameters, observer: Observer,
        lock: Optional[ContextManager[Any]] = None, clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a relay without a goal.

        Args:
            server: Client of the server's move_base action.
            compose: Makes the server's goal message from a PoseStamped; must not block.
            parameters: Timeouts.
            observer: Its hooks are called, with the lock held.
            lock: Re-entrant lock: the action server's, if there is one.
            clock: Returns wall time (s).
        """
        self._server, self._compose = server, compose
        self._parameters, self._observer = parameters, observer
        self._lock, self._clock = lock or threading.RLock(), clock
        self._current: Optional[_ActiveGoal] = None
        self._at_server: List[_SentGoal] = []  # oldest first
        self._zero_due_at = math.inf
        self._newest_stamp = 0.0
        self._over: Optional[Answer] = None  # answer to all goals once this node shuts down

    def take_goal(self, client_goal: ClientGoal, now: float) -> None:
        """Make a goal the current one; the present one ends PREEMPTED.

        Args:
            client_goal: The goal.
            now: ROS time (s), to detect a clock that was set back.
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
        """End the current goal because of a newer one whose cancel arrived first: its client wants the robot to stop.

        Goal and cancel arrive by different connections; their order must not decide whether the robot drives on.

        Args:
            client_goal: The newer goal, already RECALLED.
            now: ROS time (s), to detect a clock that was set back.
        """
        with self._lock:
            pose = client_goal.get_goal().target_pose
            if not self._is_outdated(client_goal, now) and answers.not_finite(pose.pose) is None:
                self._replace_by(client_goal)
                self._advance()

    def take_cancel(self, client_goal: ClientGoal) -> None:
        """Cancel a goal if it is the current one; all others have ended already."""
        with self._lock:
            active = self._current
            if active is None or active.client_goal.get_goal_id().id != client_goal.get_goal_id().id:
                return
            active.cancelled_at = self._clock()
            if active.sent is None:
                self._end(answers.preempted())
            self._advance()

    def check(self) -> None:
        """Check timeouts; call it a few times a second."""
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
        """Cancel at the server and abort the current goal and all that still come, because this node shuts down."""
        with self._lock:
            self._over = answers.aborted(answers.NODE_KILLED)
            self._end(self._over)
            self._advance()

    @property
    def is_pursuing(self) -> bool:
        """Whether there is a current goal."""
        return self._current is not None

    def _is_outdated(self, client_goal: ClientGoal, now: float) -> bool:
        """Return whether a newer goal came before; stamps ahead of `now` are from before the clock was set back."""
        return bool(client_goal.get_goal_id().stamp.to_sec() < self._newest_stamp <= now)

    def _replace_by(self, client_goal: ClientGoal) -> None:
        """End the current goal, if there is one, because a newer one has come."""
        self._newest_stamp = client_goal.get_goal_id().stamp.to_sec()
        self._end(answers.preempted(answers.REPLACED))

    def _lose_patience(self, active: _ActiveGoal, now: float) -> None:
        """End the current goal if it has waited too long for a server, or for the server's result after its cancel."""
        parameters = self._parameters
        if active.sent is None and now - active.waits_since > parameters.server_timeout:
            if not self._server.server_is_up:  # otherwise it waits for a predecessor, at most SUCCESSOR_PATIENCE
                self._end(answers.server_absent(parameters))
        elif active.cancelled_at is not None and now - active.cancelled_at > parameters.cancel_timeout:
            self._end(answers.preempted(reason="the server did not answer the cancel"))

    def _advance(self) -> None:
        """Cancel the goals at the server, send the current goal, or do nothing; see the module's docstring."""
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
        self._at_server.append(sent)  # before sending: it may end before `send` returns
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
                    # The C++ server may report the arrival of a replaced goal as that of the new one. The goal is sent
                    # once more; as it replaces none then, its next result is its own.
                    active.was_doubted, active.sent, active.waits_since = True, None, self._clock()
            self._advance()

    def _leave(self, sent: _SentGoal) -> None:
        """Forget a goal that has ended at the server or was given up; stop the robot if no other is left there.

        A goal that was given up, and forgotten, may still end later; the robot may have driven for it until then.
        """
        if sent in self._at_server:
            self._at_server.remove(sent)
        if not self._at_server:
            self._zero_due_at = self._clock() + ZERO_REPEATED_AFTER
            self._observer.stop_robot()

    def _end(self, answer: Answer, result: Optional[Any] = None) -> None:
        """Give the current goal, if there is one, its terminal state."""
        if self._current is not None:
            active, self._current = self._current, None
            self._give(active.client_goal, answer, result)

    def _give(self, client_goal: ClientGoal, answer: Answer, result: Optional[Any] = None) -> None:
        answer.give(client_goal)
        self._observer.goal_ended(client_goal, answer, result)


class _ActiveGoal:
    """The current goal.

    Attributes:
        client_goal: The client's goal.
        waits_since: Wall time (s) when it came, or from which it waits to be sent once more.
        sent: The goal sent to the server for it, None before.
        cancelled_at: Wall time (s) of the client's cancel, None before.
        was_doubted: Whether the server has reported an arrival before that was not accepted.
    """

    def __init__(self, client_goal: ClientGoal, now: float) -> None:
        self.client_goal, self.waits_since = client_goal, now
        self.sent: Optional[_SentGoal] = None
        self.cancelled_at: Optional[float] = None
        self.was_doubted = False


class _SentGoal:
    """A goal at the server that has not ended, and its cancels.

    Attributes:
        goal: Handle to cancel it; None until `ServerClient.send` has returned.
        first_cancel_at: Wall time (s) of the first cancel, None before.
    """

    def __init__(self) -> None:
        self.goal: Optional[ServerGoal] = None
        self.first_cancel_at: Optional[float] = None
        self._last_cancel_at = -math.inf

    def press_cancel(self, now: float) -> None:
        """Send a cancel, unless the last one is younger than CANCEL_REPEATED_AFTER."""
        if self.goal is None or now - self._last_cancel_at <= CANCEL_REPEATED_AFTER:
            return
        self._last_cancel_at = now
        if self.first_cancel_at is None:
            self.first_cancel_at = now
        self.goal.cancel()

    def is_given_up(self, now: float, timeout: float) -> bool:
        """Return whether its first cancel is more than `timeout` seconds old; no more are sent then."""
        return self.first_cancel_at is not None and now - self.first_cancel_at > timeout

    def cancel_is_under_way(self, now: float) -> bool:
        """Return whether its last cancel is younger than SUCCESSOR_PATIENCE, so that it may still be on its way."""
        return now - self._last_cancel_at < SUCCESSOR_PATIENCE
