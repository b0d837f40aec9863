"""Noticing a new master: rospy does not register again, so that a node would be there and never be found."""

from __future__ import annotations

import http.client
import threading
import xmlrpc.client  # nosec B411: what the ROS master speaks
from typing import Any, Callable, Tuple

import rosgraph
import rospy

from mbf_relay.ros.common.impatient_proxy import impatient_proxy

PERIOD = 2.0
"""Wall seconds between two looks."""
TIMEOUT = 2.0
"""Wall seconds a master may take to answer."""
SHARED = ("/use_sim_time", "/robot_description")
"""Parameters beside the node's own that it needs when it starts again."""


class MasterWatch:
    """Asks the master now and then whether it knows this node.

    A master that does not answer changes nothing: what is connected stays connected. One that answers and does not know
    the node is another one. It gets the parameters back that this node had, where it has none, and `on_stranger` is
    told.

    Args:
        on_stranger: Called with a sentence, in a thread of its own, once; it ends the process.
    """

    def __init__(self, on_stranger: Callable[[str], None]) -> None:
        self._on_stranger = on_stranger
        self._name, self._uri = rospy.get_name(), rosgraph.get_master_uri()
        self._parameters = {name: rospy.get_param(name) for name in (self._name, *SHARED) if rospy.has_param(name)}
        self._silent = False
        self._stop = threading.Event()
        rospy.on_shutdown(self._stop.set)
        self._pid = int(self._ask(xmlrpc.client.ServerProxy(self._uri).getPid)[1])
        threading.Thread(target=self._loop, name="master watch", daemon=True).start()

    def _loop(self) -> None:
        while not self._stop.wait(PERIOD):
            try:
                known = self._is_known()
            except (OSError, xmlrpc.client.Error, http.client.HTTPException) as error:
                if not self._silent:
                    rospy.logwarn("the master at %s does not answer (%s); what is connected stays so", self._uri, error)
                self._silent = True
                continue
            if known:
                self._silent = False
            elif not (self._stop.is_set() or rospy.is_shutdown()):
                self._on_stranger(
                    f"the master at {self._uri} is another one and does not know {self._name}; it must start again"
                )
                return

    def _is_known(self) -> bool:
        master = impatient_proxy(self._uri, TIMEOUT)
        pid = int(self._ask(master.getPid)[1])
        # A registration that was under way may have reached the new master, and it alone.
        if pid == self._pid and self._ask(master.lookupNode, self._name)[0]:
            return True
        for name, value in self._parameters.items():
            if not self._ask(master.hasParam, name)[1]:
                self._ask(master.setParam, name, value)
        return False

    def _ask(self, call: Callable[..., Any], *arguments: Any) -> Tuple[bool, Any]:
        """Return whether the master could say, and what it said."""
        code, _, value = call(self._name, *arguments)
        return code == 1, value
