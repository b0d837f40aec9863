"""The relay's core: move_base's goals, carried out by a Move Base Flex server.

It pursues one goal at a time, as move_base does. What the goal's client sees:

    goal arrives ----------> ACTIVE --- the server ends it ------------> SUCCEEDED or ABORTED
      |                        |------- a newer goal arrives ----------> PREEMPTED, at once
      |                        |------- no server in `server_timeout` -> ABORTED
      |                        |------- the server dies ---------------> ABORTED, and the robot is stopped
      |                        `-- cancel --> PREEMPTING -- the server ends it --> PREEMPTED (or what came first)
      `-- older than the newest goal seen ---------------------------------------> RECALLED

The server replaces a running goal when the next one comes, without stopping the robot, so a replaced goal is not
cancelled there. One whose cancel is under way is different: the next goal waits until the server has answered, because
a late cancel would hit the new goal in servers that cancel whatever runs.

Nothing here knows topics: goal handles, the server's client and the effects are handed in.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, ContextManager, Optional

from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseFeedback

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.ros import relay_answers
from mbf_relay.ros.action_client import Ending
from mbf_relay.ros.relay_answers import Answer

CANCEL_REPEATED_AFTER = 1.0
"""Wall time (s) without an answer after which a cancel is sent again."""
SUCCESSOR_PATIENCE = 2.0
"""Wall time (s) a goal waits for the end of a cancelled predecessor."""


@dataclass(frozen=True)
class RelayParameters(ParameterSet):
    """Parameters of the relay itself; move_base's own are in relay_reconfigure."""

    server: str = parameter("move_base_flex", "name of the Move Base Flex node")
    server_timeout: float = parameter(20.0, "how long a goal waits for the server to appear", unit="s", minimum=0.0)
    silence_timeout: float = parameter(5.0, "silence after which a connected server counts as hung", unit="s", above=0.0)
    cancel_timeout: float = parameter(20.0, "how long a cancelled goal waits for the server", unit="s", above=0.0)
    stop_on_server_loss: bool = parameter(True, "send zero velocity when the server is lost under a goal")
    global_frame: str = parameter("map", "frame of ~current_goal")


class Effects:
    """What the relay brings about besides answers to its clients; the ROS edge overrides what it publishes."""

    def goal_taken(self, pose: Any) -> None:
        """A goal is pursued from now on; `pose` is its PoseStamped."""

    def goal_ended(self, front: Any, answer: Answer, result: Optional[Any]) -> None:
        """A goal has its answer; `result` is the server's result message where there is one."""

    def robot_seen(self, pose: Any) -> None:
        """The server said where the robot is; `pose` is a PoseStamped."""

    def stop_robot(self) -> None:
        """The server is gone, and nobody else will stop the robot."""


class Relay:
    """Takes goals and cancels from move_base's side, asks the server, and answers.

    Every method may be called from any thread. The one lock is the action server's own, because goal callbacks already
    hold it and goal handles take it.
    """

    def __init__(
        self, server: Any, compose: Callable[[Any], Any], parameters: RelayParameters, effects: Effects,
        lock: Optional[ContextManager[Any]] = None, clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a relay that pursues nothing.

        Args:
            server: An ActionClient of the server's move_base action: `server_is_up`, `send(goal, on_feedback, on_end)`.
            compose: Makes the server's goal message of a PoseStamped.
            parameters: Timeouts.
            effects: Told what happens.
            lock: Re-entrant; the action server's where there is one.
            clock: Gives wall time (s).
        """
        self._server, self._compose = server, compose
        self._parameters, self._effects = parameters, effects
        self._lock, self._clock = lock or threading.RLock(), clock
        self._current: Optional[_Pursuit] = None
        self._last_sent: Optional[_Pursuit] = None
        self._newest_stamp = 0.0

    def take_goal(self, front: Any, now: float) -> None:
        """Pursue a goal in place of the present one.

        Args:
            front: The client's goal, with the methods of actionlib's ServerGoalHandle.
            now: ROS time (s), to know a clock that was set back.
        """
        with self._lock:
            stamp = front.get_goal_id().stamp.to_sec()
            if stamp < self._newest_stamp <= now:
                front.set_canceled(None, relay_answers.REPLACED)
                return
            self._newest_stamp = stamp
            replaced = self._current
            if replaced is not None:
                self._answer(replaced, relay_answers.preempted(relay_answers.REPLACED))
            front.set_accepted(relay_answers.ACCEPTED)
            self._current = _Pursuit(front, self._clock())
            pose = front.get_goal().target_pose
            self._effects.goal_taken(pose)
            if not relay_answers.is_upright(pose.pose.orientation):
                self._answer(self._current, relay_answers.aborted(relay_answers.INVALID_QUATERNION))
                self._cancel_at_server()
            self._pass_on()

    def take_cancel(self, front: Any) -> None:
        """Cancel a goal, if it is the one pursued; any other has its answer already."""
        with self._lock:
            pursuit = self._current
            if pursuit is None or pursuit.front.get_goal_id().id != front.get_goal_id().id:
                return
            self._cancel_at_server()
            if pursuit.sent is None:
                self._answer(pursuit, relay_answers.preempted())

    def check(self) -> None:
        """Let time pass: give up waiting where it took too long. Call a few times a second."""
        with self._lock:
            self._pass_on()
            pursuit, now = self._current, self._clock()
            if pursuit is None:
                self._press_cancel(now)
                return
            if pursuit.sent is None and now - pursuit.taken_at > self._parameters.server_timeout:
                self._cancel_at_server()
                self._answer(pursuit, relay_answers.server_absent(self._parameters))
            elif pursuit.cancelled_at is not None and now - pursuit.cancelled_at > self._parameters.cancel_timeout:
                self._answer(pursuit, relay_answers.preempted(reason="the server did not answer the cancel"))
            elif pursuit.cancelled_at is not None:
                self._press_cancel(now)

    def shut_down(self) -> None:
        """Cancel at the server and abort, because this node ends."""
        with self._lock:
            if self._current is not None:
                self._cancel_at_server()
                self._answer(self._current, relay_answers.aborted(relay_answers.NODE_KILLED))

    @property
    def is_pursuing(self) -> bool:
        """Whether there is a goal without its answer."""
        return self._current is not None

    def _pass_on(self) -> None:
        """Send the present goal to the server, if it still is to be sent and the server can take it."""
        pursuit, before = self._current, self._last_sent
        if pursuit is None or pursuit.sent is not None or not self._server.server_is_up:
            return
        if before is not None and before.cancel_is_under_way(self._clock()):
            return
        self._last_sent = pursuit
        pursuit.sent = self._server.send(
            self._compose(pursuit.front.get_goal().target_pose),
            on_feedback=lambda feedback: self._take_feedback(pursuit, feedback),
            on_end=lambda ending: self._take_ending(pursuit, ending),
        )

    def _take_feedback(self, pursuit: "_Pursuit", feedback: Any) -> None:
        with self._lock:
            if pursuit is self._current:
                self._effects.robot_seen(feedback.current_pose)
                pursuit.front.publish_feedback(MoveBaseFeedback(base_position=feedback.current_pose))

    def _take_ending(self, pursuit: "_Pursuit", ending: Ending) -> None:
        with self._lock:
            pursuit.ended = True
            if ending.status == GoalStatus.LOST and pursuit is self._last_sent:
                self._effects.stop_robot()
            if pursuit is self._current:
                self._answer(pursuit, relay_answers.answer_to(ending, pursuit.cancelled_at is not None), ending.result)
            self._pass_on()

    def _cancel_at_server(self) -> None:
        """Cancel what the server was sent last: the present goal, or the one it was to replace."""
        pursuit = self._last_sent
        if pursuit is not None and not pursuit.ended:
            pursuit.cancel_sent_at = self._clock()
            if pursuit.cancelled_at is None:
                pursuit.cancelled_at = pursuit.cancel_sent_at
            pursuit.sent.cancel()

    def _press_cancel(self, now: float) -> None:
        """Repeat a cancel without an answer, also of a goal whose client has its own: nobody else would stop the robot."""
        last = self._last_sent
        if last is None or last.cancelled_at is None or last.ended:
            return
        is_due = now - last.cancel_sent_at > CANCEL_REPEATED_AFTER
        if is_due and now - last.cancelled_at <= self._parameters.cancel_timeout:
            self._cancel_at_server()

    def _answer(self, pursuit: "_Pursuit", answer: Answer, result: Optional[Any] = None) -> None:
        """Give a goal its one terminal state."""
        if pursuit is self._current:
            self._current = None
        answer.give(pursuit.front)
        self._effects.goal_ended(pursuit.front, answer, result)


class _Pursuit:
    """A client's goal and its counterpart at the server."""

    def __init__(self, front: Any, now: float) -> None:
        self.front = front
        self.taken_at = now
        self.sent: Optional[Any] = None
        self.cancelled_at: Optional[float] = None
        self.cancel_sent_at = now
        self.ended = False

    def cancel_is_under_way(self, now: float) -> bool:
        """Whether the server was asked to cancel it, has not answered, and may still be expected to."""
        return self.cancelled_at is not None and not self.ended and now - self.cancel_sent_at < SUCCESSOR_PATIENCE
