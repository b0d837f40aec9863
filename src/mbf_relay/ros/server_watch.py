"""Is the action server still there? Asked on the wall clock, whatever the ROS clock does.

A living server publishes its status several times a second of ROS time. A closed connection is the first sign of its
end. Silence is the second, and then its node is asked directly: one that answers may stay silent while the ROS clock
stands still, one that refuses is gone, one that does not answer is given `silence_timeout`.
"""

from __future__ import annotations

import http.client
import math
import time
import xmlrpc.client
from typing import Any, Callable, Optional

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatusArray

DISCONNECTED_FOR = 0.3
"""Wall time (s) without a connection after which a server that was there counts as gone."""
SILENT_FOR = 1.0
"""Wall time (s) without a status message after which the node is asked."""
ASK_TIMEOUT = 0.3
"""Wall time (s) a node has for its answer."""


class ServerWatch:
    """Watches one action server through its status topic.

    Attributes:
        is_up: Whether it is there.
        loss: How it was lost last; empty where it never was.
    """

    def __init__(
        self, name: str, takes_goals: Callable[[str], bool], silence_timeout: float,
        on_status: Callable[[GoalStatusArray], None],
    ) -> None:
        """Expect a server.

        Args:
            name: The action's name.
            takes_goals: Tells whether a node listens to goals; a node that does not is no server, whatever it says.
            silence_timeout: Wall time (s) of silence after which a server that is connected counts as gone.
            on_status: Called with each status message of the server's.
        """
        self.is_up = False
        self.loss = ""
        self._name = name
        self._takes_goals, self._on_status = takes_goals, on_status
        self._silence_timeout = silence_timeout
        self._node = ""
        self._heard_at = self._connected_at = self._asked_at = 0.0
        self._heard_at_ros_time = 0.0
        self._subscriber = rospy.Subscriber(f"{name}/status", GoalStatusArray, self._hear, tcp_nodelay=True)

    @property
    def is_connected(self) -> bool:
        """Whether somebody publishes the status."""
        return self._subscriber.get_num_connections() > 0

    @property
    def silence(self) -> float:
        """Wall time (s) since the server's last word, infinite before the first."""
        return time.monotonic() - self._heard_at if self._node else math.inf

    def close(self) -> None:
        """Stop listening."""
        self._subscriber.unregister()

    def why_lost(self, now: float) -> Optional[str]:
        """Return why the server is gone, None while it is there (or never was, or its loss is already known).

        Args:
            now: Wall time (s), of time.monotonic.
        """
        if not self.is_up:
            self._look_for_a_silent_one(now)
            return None
        reason = self._find_reason(now)
        if reason is None:
            return None
        self.is_up = False
        self.loss = f"action server {self._name} {reason}"
        return self.loss

    def _hear(self, message: GoalStatusArray) -> None:
        node = message._connection_header["callerid"]
        if self._takes_goals(node):
            self._note_life(node)
            self._on_status(message)

    def _note_life(self, node: str) -> None:
        self._node = node
        self._heard_at = self._connected_at = time.monotonic()
        self._heard_at_ros_time = rospy.get_rostime().to_sec()
        self.is_up = True

    def _look_for_a_silent_one(self, now: float) -> None:
        """Find a server that is connected and says nothing, because the ROS clock stands still."""
        connections = self._subscriber.impl.connections if self._subscriber.impl else []
        nodes = [link.callerid_pub for link in connections if link.callerid_pub and self._takes_goals(link.callerid_pub)]
        if nodes and now - self._asked_at > SILENT_FOR / 2.0:
            self._asked_at = now
            if ask_node(nodes[-1]) == THERE:
                self._note_life(nodes[-1])

    def _find_reason(self, now: float) -> Optional[str]:
        if self.is_connected:
            self._connected_at = now
        elif now - self._connected_at > DISCONNECTED_FOR:
            return f"died: its node {self._node} closed the connection"
        silence = now - self._heard_at
        if silence < SILENT_FOR or now - self._asked_at < SILENT_FOR / 2.0:
            return None
        self._asked_at = now
        answer = ask_node(self._node)
        if answer == GONE:
            return f"died: its node {self._node} does not exist any more"
        clock_ran = rospy.get_rostime().to_sec() - self._heard_at_ros_time > SILENT_FOR
        if silence > self._silence_timeout and (answer == MUTE or clock_ran):
            return f"hangs: its node {self._node} has been silent for {silence:.1f} s"
        return None


THERE, MUTE, GONE = "there", "mute", "gone"


def ask_node(node: str, timeout: float = ASK_TIMEOUT) -> str:
    """Ask a node for a sign of life: THERE, MUTE (no answer in `timeout` s of wall time) or GONE (refused, unknown)."""
    try:
        uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
    except rosgraph.MasterError:
        return GONE
    except OSError:
        return MUTE  # no master to ask: that says nothing about the node
    try:
        xmlrpc.client.ServerProxy(uri, transport=_ImpatientTransport(timeout)).getPid(rospy.get_name())
    except ConnectionRefusedError:
        return GONE
    except (OSError, http.client.HTTPException, xmlrpc.client.Error):
        return MUTE
    return THERE


class _ImpatientTransport(xmlrpc.client.Transport):
    """xmlrpc over http with a timeout."""

    def __init__(self, timeout: float) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._timeout
        return connection
