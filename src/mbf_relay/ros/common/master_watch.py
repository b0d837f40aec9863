"""Notices a restarted master, and use_sim_time set after the node's start; rospy checks for neither.

A restarted master does not know the node, so that nobody can connect to it. A node that started by the wall clock finds
every simulated stamp decades old.
"""

from __future__ import annotations

import threading
import xmlrpc.client  # nosec B411: what the ROS master speaks
from typing import Any, Callable, Dict, Tuple

import rosgraph
import rospy
from rospy import rostime

from mbf_relay.ros.common.impatient_proxy import NO_ANSWER, impatient_proxy

PERIOD = 2.0
"""Wall seconds between two checks."""
TIMEOUT = 2.0
"""Wall seconds a master may take to answer."""
TRIES = 20
"""Calls after which an XML-RPC fault is raised. rosmaster answers a call with a fault now and then while others set
parameters, as during a launch; the next call mostly succeeds."""
GIVEN_BACK_WITHIN = 3.0 * PERIOD
"""Wall seconds after a new master's start within which the surviving nodes restore the parameters it had before."""
RUN_ID = "run_id"
"""roslaunch's parameter with the id of its run."""
SHARED = ("use_sim_time", "robot_description")
"""Parameters that a node needs when it starts again, beside its own."""


class MasterWatch:
    """Asks the master every PERIOD whether it knows this node, and ends the process where it does not.

    A master that does not answer changes nothing: open connections go on. One that answers but does not know the node
    was restarted. This node then restores its own parameters there, as far as they are missing. One PERIOD later, when
    all surviving nodes had time for theirs, it also restores the others that it saw at its start: those of nodes that
    died with the old master, which would start again with defaults, such as another robot's limits. Last, `on_stranger`
    is called, as it is where `other_time` gives a reason.

    Args:
        on_stranger: Called once, in the watch's thread, with the reason; it ends the process.
    """

    def __init__(self, on_stranger: Callable[[str], None]) -> None:
        self._on_stranger = on_stranger
        self._name, self._uri = rospy.get_name(), rosgraph.get_master_uri()
        self._silent, self._by_wall_clock = False, rostime.is_wallclock()
        self._stop = threading.Event()
        rospy.on_shutdown(self._stop.set)
        master = xmlrpc.client.ServerProxy(self._uri)
        # all parameters at the start; asked of the master, since rospy.get_param mixes in its cache
        self._seen: Dict[str, Any] = self._ask(master.getParam, "/")[1]
        self._pid = int(self._ask(master.getPid)[1])
        threading.Thread(target=self._loop, name="master watch", daemon=True).start()

    def _loop(self) -> None:
        while not self._stop.wait(PERIOD):
            try:
                if self._is_known():
                    trouble = self.other_time()
                else:
                    self._restore_parameters()
                    trouble = (
                        f"the master at {self._uri} is another one and does not know {self._name}; it must start again")
            except NO_ANSWER as error:
                if not self._silent:
                    rospy.logwarn("the master at %s does not answer (%s); open connections go on", self._uri, error)
                self._silent = True
                continue
            self._silent = False
            if trouble and not (self._stop.is_set() or rospy.is_shutdown()):
                self._on_stranger(trouble)
                return

    def other_time(self) -> str:
        """Return why a node that started by the wall clock must restart in simulated time; empty where it need not.

        The parameter alone is no reason, as it may have been set by mistake: somebody must publish /clock, too.
        """
        if not self._by_wall_clock:
            return ""
        master = impatient_proxy(self._uri, TIMEOUT)
        if self._ask(master.getParam, "/use_sim_time") != (True, True):
            return ""
        publishers = dict(self._ask(master.getSystemState)[1][0]).get("/clock", [])
        if not publishers or self._name in publishers:
            return ""
        return (
            f"use_sim_time was set after {self._name} had begun, which goes by the wall clock and not by the /clock of "
            f"{', '.join(publishers)}; it must start again")

    def _is_known(self) -> bool:
        """Return whether the master is the one at the start, and knows this node."""
        master = impatient_proxy(self._uri, TIMEOUT)
        # To know the node is not enough: a registration under way may have reached a new master.
        return int(self._ask(master.getPid)[1]) == self._pid and self._ask(master.lookupNode, self._name)[0]

    def _restore_parameters(self) -> None:
        """Set the parameters that a new master lacks: first this node's, and one PERIOD later the others."""
        own = {name: self._seen[name] for name in SHARED if name in self._seen}
        self._give_back({**own, **part_of(self._seen, self._name)})
        if not self._stop.wait(PERIOD):
            self._give_back({name: value for name, value in self._seen.items() if name != RUN_ID})
            self._give_back(self._seen)  # the run_id last: nodes that start meanwhile wait for it

    def _give_back(self, seen: Dict[str, Any]) -> None:
        """Set those of a tree of parameters that the master lacks; a group that it lacks as a whole, in one call."""
        master = impatient_proxy(self._uri, TIMEOUT)

        def complete(seen: Dict[str, Any], there: Any, path: str) -> None:
            for name, value in seen.items():
                if not isinstance(there, dict) or name not in there:
                    self._ask(master.setParam, path + name, value)
                elif isinstance(value, dict):
                    complete(value, there[name], f"{path}{name}/")

        complete(seen, self._ask(master.getParam, "/")[1], "/")

    def _ask(self, call: Callable[..., Any], *arguments: Any) -> Tuple[bool, Any]:
        """Call the master; return whether the call succeeded, and its value.

        rosmaster answers with a fault where a parameter is set while it writes its answer; see TRIES.
        """
        for left in reversed(range(TRIES)):
            try:
                code, _, value = call(self._name, *arguments)
                return code == 1, value
            except xmlrpc.client.Fault:
                if not left:
                    raise
        raise AssertionError("not reached")


def part_of(tree: Dict[str, Any], name: str) -> Dict[str, Any]:
    """Return the part of a tree of parameters below a node's name, as a tree from the root on; {} where it has none."""
    group, *rest = name.strip("/").split("/", 1)
    if group not in tree:
        return {}
    if not rest:
        return {group: tree[group]}
    below = part_of(tree[group], rest[0]) if isinstance(tree[group], dict) else {}
    return {group: below} if below else {}
