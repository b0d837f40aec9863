"""An action client that notices by the wall clock when its server is gone.

`client_goals` keeps the goals, `server_watch` tells whether the server is there; this module has the topics. `check`
has to be called a few times a second, which methods that wait do themselves.
"""

from __future__ import annotations

import time
from typing import Any, Callable, List, Optional

import rospy
from actionlib_msgs.msg import GoalID

from mbf_relay.ros.common.actions.client_goals import ActionEnding, ClientGoals, SentGoal
from mbf_relay.ros.common.actions.server_watch import ServerWatch

STRANGERS_PERIOD = 10.0
"""Seconds between two warnings of a node that publishes feedback or results without being the server."""


class ActionClient:
    """Sends goals to one action server."""

    def __init__(
        self, name: str, action_type: Any, acknowledge_timeout: float = 10.0, silence_timeout: float = 5.0,
        leased: bool = False,
    ) -> None:
        """Connect to an action.

        Args:
            name: The action's name.
            action_type: Its generated `...Action` message.
            acknowledge_timeout: Wall time (s) after which a goal the server never acknowledged is LOST.
            silence_timeout: Wall time (s) of a connected server's silence after which it counts as gone.
            leased: Whether goals are leased (see `goal_lease`), so that they end with this client; `check` must then be
                called every 0.2 s.
        """
        action = action_type()
        self.name = rospy.resolve_name(name)
        self._goals = ClientGoals(
            self.name,
            rospy.get_name(),
            type(action.action_goal),
            self,
            acknowledge_timeout,
            time.monotonic,
            rospy.get_rostime,
            self._keep_up,
        )
        options = {"queue_size": 100, "tcp_nodelay": True}
        # before the goals' topic, so that it is connected when goals can be sent, if the server supports leases
        self._lease_publisher = rospy.Publisher(f"{self.name}/lease", GoalID, **options) if leased else None
        self._cancel_publisher = rospy.Publisher(f"{self.name}/cancel", GoalID, **options)
        self._goal_publisher = rospy.Publisher(f"{self.name}/goal", type(action.action_goal), **options)
        feedback, result = type(action.action_feedback), type(action.action_result)
        self._subscribers = [
            rospy.Subscriber(f"{self.name}/{topic}", kind, self._take_from_server, take, tcp_nodelay=True)
            for topic, kind, take in (
                ("result", result, self._goals.take_result), ("feedback", feedback, self._goals.take_feedback))
        ]
        self._watch = ServerWatch(
            self.name, self._goal_publisher.impl.has_connection, silence_timeout, self._goals.take_status)

    @property
    def server_is_up(self) -> bool:
        """Whether a server has been heard and is connected both ways, so that a goal sent now will arrive."""
        links = (*self._subscribers, self._goal_publisher, self._cancel_publisher)
        return self._watch.is_up and self._watch.is_connected and all(link.get_num_connections() for link in links)

    @property
    def server_silence(self) -> float:
        """Wall time (s) since the server's last status message or answer, infinite before the first."""
        return self._watch.silence

    @property
    def why_down(self) -> str:
        """Why `server_is_up` is False: how the server was lost, where it was."""
        lost = "" if self._watch.is_up else self._watch.loss
        return lost or f"action server {self.name} is not there; is it running?"

    @property
    def open_goals(self) -> List[str]:
        """The ids of the goals that have not ended."""
        return self._goals.open_goals

    def wait_for_server(self, timeout: float) -> bool:
        """Wait up to `timeout` seconds of wall time for a server; return whether there is one."""
        deadline = time.monotonic() + timeout
        while not self.server_is_up and time.monotonic() < deadline and not rospy.is_shutdown():
            self.check()
            time.sleep(0.02)
        return self.server_is_up

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
        return self._goals.send(goal, on_feedback, on_end)

    def cancel_all(self) -> None:
        """Ask the server to cancel all goals of this client that have not ended."""
        self._goals.cancel_all()

    def check(self) -> None:
        """Renew leases, resend goals that were not acknowledged, and end goals as LOST where the server is gone."""
        self._goals.check(self._watch.why_lost(time.monotonic()))

    def close(self) -> None:
        """Unsubscribe and unadvertise all topics."""
        self._watch.close()
        for link in (*self._subscribers, self._goal_publisher, self._cancel_publisher, self._lease_publisher):
            if link is not None:
                link.unregister()

    def _take_from_server(self, message: Any, take: Callable[[Any], None]) -> None:
        """Pass on a message of this client's goals if it is the server's; warn of other publishers."""
        if not self._goals.knows(message.status.goal_id.id):
            return
        if self._watch.is_from_server(message):
            take(message)
        else:
            rospy.logwarn_throttle(
                STRANGERS_PERIOD, f"{message._connection_header.get('callerid', '')} publishes as the action server "
                f"{self.name} without being it: its messages are ignored")

    def _keep_up(self) -> bool:
        self.check()
        return not rospy.is_shutdown()

    # the way to the server

    @property
    def takes_leases(self) -> bool:
        """Whether goals are to be leased and the server supports that."""
        return self._lease_publisher is not None and self._lease_publisher.get_num_connections() > 0

    def publish_goal(self, message: Any) -> None:
        """Send a goal message."""
        self._goal_publisher.publish(message)

    def publish_cancel(self, goal_id: GoalID) -> None:
        """Send a cancel."""
        self._cancel_publisher.publish(goal_id)

    def renew(self, goal_id: GoalID) -> None:
        """Send the renewal of a lease."""
        if self._lease_publisher is not None:
            self._lease_publisher.publish(goal_id)
