"""Watches by the wall clock whether an action server is alive.

A server publishes its status several times a second of ROS time. A closed connection is the first sign of its end, the
second is silence; then its node is called directly (XML-RPC getPid). If it answers, it is alive and may be silent
because the ROS clock stands still. If it refuses the connection, it is gone. If it does not answer, it has
`silence_timeout`. The master is asked only for the node's address where no connection tells it, and like the node for
no longer than ASK_TIMEOUT, as it may hang itself.

The time of silence is summed up from check to check, and each adds LOOK at most: a check that comes late, or a jump of
the ROS clock, is no evidence that the server was silent.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Callable, Dict, Optional

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatusArray

from mbf_relay.ros.common.connected_nodes import connected_nodes
from mbf_relay.ros.common.impatient_proxy import NO_ANSWER, impatient_proxy

DISCONNECTED_FOR = 0.3
"""Wall time (s) without a connection after which a server that was there counts as gone."""
SILENT_FOR = 0.5
"""Wall time (s) without a status message, which comes five times a second, after which the node is called."""
CLOCK_RAN = 1.0
"""ROS time (s) without a status message above which a standing clock does not explain the silence."""
ASK_TIMEOUT = 0.3
"""Wall time (s) a node has to answer a call."""
TRIES = 3
"""Number of calls before another server of the action counts as dead, as a busy machine answers late."""
LOOK = 0.3
"""Largest time (s) that one check adds to the silence: the time between two checks with a call in between."""


class ServerWatch:
    """Watches one action server through its status topic.

    Attributes:
        is_up: Whether the server is alive.
        loss: How it was lost last; empty where it never was.
    """

    def __init__(
        self, name: str, takes_goals: Callable[[str], bool], silence_timeout: float,
        on_status: Callable[[GoalStatusArray], None],
    ) -> None:
        """Subscribe to the status.

        Args:
            name: The action's name.
            takes_goals: Returns whether a node, by name, subscribes to goals; one that does not is no server.
            silence_timeout: Wall time (s) of silence after which a server that is connected counts as gone.
            on_status: Called with each status message of the server's.
        """
        self.is_up = False
        self.loss = ""
        self._name = name
        self._takes_goals, self._on_status = takes_goals, on_status
        self._silence_timeout = silence_timeout
        self._node = self._address = ""
        self._heard_at = self._connected_at = self._asked_at = 0.0
        self._counting = threading.Lock()  # guards the times: status messages come on another thread than checks
        self._looked_at = self._looked_at_ros_time = 0.0
        self._lifeless = 0.0  # wall time (s) without status message or answer
        self._ran = 0.0  # ROS time (s) without a status message
        self._subscriber: Optional[rospy.Subscriber] = None  # a status may arrive before the constructor has returned
        self._subscriber = rospy.Subscriber(f"{name}/status", GoalStatusArray, self._hear, tcp_nodelay=True)

    @property
    def is_connected(self) -> bool:
        """Whether the status has a publisher."""
        return self._subscriber is not None and bool(self._subscriber.get_num_connections())

    @property
    def silence(self) -> float:
        """Wall time (s) since the server's last status message or answer, infinite before the first."""
        return time.monotonic() - self._heard_at if self._node else math.inf

    def is_from_server(self, message: Any) -> bool:
        """Return whether a message is from the current server, or from a node that publishes status and takes goals."""
        node = message._connection_header.get("callerid", "")
        return node == self._node or (node in self._connections() and self._takes_goals(node))

    def close(self) -> None:
        """Stop listening."""
        if self._subscriber is not None:
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
        node = message._connection_header.get("callerid", "")
        if self._takes_goals(node):
            self._note_life(node)
            self._on_status(message)

    def _note_life(self, node: str) -> None:
        self._node, self._address = node, self._connections().get(node, self._address if node == self._node else "")
        with self._counting:
            self._heard_at = self._connected_at = self._looked_at = time.monotonic()
            self._looked_at_ros_time = rospy.get_rostime().to_sec()
            self._lifeless = self._ran = 0.0
        self.is_up = True

    def _look_for_a_silent_one(self, now: float) -> None:
        """Find a server that is connected but silent, because the ROS clock stands still."""
        nodes = [node for node in self._connections() if self._takes_goals(node)]
        if nodes and now - self._asked_at > SILENT_FOR / 2.0:
            self._asked_at = now
            if ask_node(nodes[-1], self._connections().get(nodes[-1], "")) == THERE:
                self._note_life(nodes[-1])

    def _connections(self) -> Dict[str, str]:
        """Return the XML-RPC URIs of the nodes that publish the status, by name, newest last."""
        return {} if self._subscriber is None else connected_nodes(self._subscriber)

    def _find_reason(self, now: float) -> Optional[str]:
        if self.is_connected:
            self._connected_at = now
        elif now - self._connected_at > DISCONNECTED_FOR:
            return f"died: its node {self._node} closed the connection"
        if self._connections().get(self._node, self._address) != self._address:
            self._note_life(self._node)  # restarted under the same name: the silence was its predecessor's
        self._add_silence()
        if self._lifeless >= SILENT_FOR and now - self._asked_at >= SILENT_FOR / 2.0:
            self._asked_at = now
            # without a connection it may have been restarted elsewhere: ask_node then asks the master
            answer = ask_node(self._node, self._connections().get(self._node, ""))
            if answer == GONE:
                return f"died: its node {self._node} does not exist any more"
            self._add_silence()
            if answer == THERE:
                self._lifeless = 0.0
        if self._lifeless > self._silence_timeout or (
                self._ran > CLOCK_RAN and self.silence > self._silence_timeout):
            return f"hangs: its node {self._node} has been silent for {self.silence:.1f} s"
        return None

    def _add_silence(self) -> None:
        """Add the time since the last check; status messages reset it."""
        now, ros_now = time.monotonic(), rospy.get_rostime().to_sec()
        with self._counting:
            passed = min(LOOK, max(0.0, now - self._looked_at))
            self._lifeless += passed
            self._ran += min(passed, max(0.0, ros_now - self._looked_at_ros_time))
            self._looked_at, self._looked_at_ros_time = now, ros_now


THERE, MUTE, GONE = "there", "mute", "gone"
"""Results of `ask_node`."""


def ask_node(node: str, address: str = "") -> str:
    """Call a node by XML-RPC to see whether it is alive, with ASK_TIMEOUT for each answer.

    Args:
        node: Its name.
        address: Its XML-RPC URI; where empty, the master is asked for it.

    Returns:
        THERE, MUTE (no answer in time) or GONE (refused, or unknown to the master).
    """
    here = rospy.get_name()
    try:
        if not address:
            answer: Any = impatient_proxy(rosgraph.get_master_uri(), ASK_TIMEOUT).lookupNode(here, node)
            code, _, address = answer
            if code != 1:
                return GONE
    except NO_ANSWER:
        return MUTE  # without an answer of the master nothing is known of the node
    try:
        impatient_proxy(address, ASK_TIMEOUT).getPid(here)
    except ConnectionRefusedError:
        return GONE
    except NO_ANSWER:
        return MUTE
    return THERE


def check_alone(action: str) -> None:
    """Check that no other node serves an action: goals would go to both, and clients would get answers from both.

    To be called before the topics are advertised and again after that, for two that start at the same moment: the
    master then has both in the order of their registration, and the second is refused.

    Raises:
        ValueError: Another node that is alive was first.
    """
    here, action = rospy.get_name(), rospy.resolve_name(action)
    try:
        answer: Any = impatient_proxy(rosgraph.get_master_uri(), ASK_TIMEOUT).getSystemState(here)
    except NO_ANSWER:
        return  # nothing is known without the master; MasterWatch watches it
    publishers, subscribers = map(dict, answer[2][:2])
    take_goals = subscribers.get(rospy.resolve_name(f"{action}/goal"), [])
    if here in take_goals:
        take_goals = take_goals[:take_goals.index(here)]
    for node in publishers.get(rospy.resolve_name(f"{action}/result"), []):
        if node != here and node in take_goals and any(ask_node(node) == THERE for _ in range(TRIES)):
            raise ValueError(
                f"{node} serves the action {rospy.resolve_name(action)} already: goals would go to both, and get lost "
                f"between them; end it first (rosnode kill {node}), or give this one a namespace (__ns:=NAME)")
