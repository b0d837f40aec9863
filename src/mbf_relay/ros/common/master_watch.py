"""Noticing a new master, or that time is simulated since: rospy looks for neither again.

A node would be there and never be found, or find all that it hears older than itself by as much as 1970 is.
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
"""Wall seconds between two looks."""
TIMEOUT = 2.0
"""Wall seconds a master may take to answer."""
TRIES = 20
"""Times a master is asked before its fault is none of the moment: while a launch starts, one answer of many is one."""
GIVEN_BACK_WITHIN = 3.0 * PERIOD
"""Wall seconds after a new master's start in which those that live give it the parameters of those that died."""
RUN_ID = "run_id"
"""Parameter that tells roslaunch's runs apart."""
SHARED = ("use_sim_time", "robot_description")
"""Parameters beside the node's own that it needs when it starts again."""


class MasterWatch:
    """Asks the master now and then whether it knows this node.

    A master that does not answer changes nothing: what is connected stays connected. One that answers and does not know
    the node is another one. It gets the parameters back that this node had, where it has none. A node that died
    before can give nothing back, and would start again with defaults, a larger robot's limits among them: what it had
    is given back by those that saw it when they started, after all that live had time for their own. Then
    `on_stranger` is told; so it is where `other_time` has something to say.

    Args:
        on_stranger: Called with a sentence, in a thread of its own, once; it ends the process.
    """

    def __init__(self, on_stranger: Callable[[str], None]) -> None:
        self._on_stranger = on_stranger
        self._name, self._uri = rospy.get_name(), rosgraph.get_master_uri()
        self._silent, self._by_wall_clock = False, rostime.is_wallclock()
        self._stop = threading.Event()
        rospy.on_shutdown(self._stop.set)
        master = xmlrpc.client.ServerProxy(self._uri)
        self._seen: Dict[str, Any] = self._ask(master.getParam, "/")[1]  # rospy's own answer has what is in its cache
        self._pid = int(self._ask(master.getPid)[1])
        threading.Thread(target=self._loop, name="master watch", daemon=True).start()

    def _loop(self) -> None:
        while not self._stop.wait(PERIOD):
            try:
                known = self._is_known()
                trouble = self.other_time() if known else (
                    f"the master at {self._uri} is another one and does not know {self._name}; it must start again")
            except NO_ANSWER as error:
                if not self._silent:
                    rospy.logwarn("the master at %s does not answer (%s); open connections go on", self._uri, error)
                self._silent = True
                continue
            self._silent = self._silent and not known
            if trouble and not (self._stop.is_set() or rospy.is_shutdown()):
                self._on_stranger(trouble)
                return

    def other_time(self) -> str:
        """Return why a node that began by the wall clock has to start again in simulated time; empty where it need not.

        The parameter alone is no reason, as it may have been set by mistake, and so that nobody makes the time.
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
        master = impatient_proxy(self._uri, TIMEOUT)
        pid = int(self._ask(master.getPid)[1])
        # A registration that was under way may have reached the new master, and it alone.
        if pid == self._pid and self._ask(master.lookupNode, self._name)[0]:
            return True
        own = {name: self._seen[name] for name in SHARED if name in self._seen}
        self._give_back({**own, **part_of(self._seen, self._name)})
        if not self._stop.wait(PERIOD):
            rest = dict(self._seen)
            run_id = {RUN_ID: rest.pop(RUN_ID)} if RUN_ID in rest else {}
            self._give_back(rest)
            self._give_back(run_id)  # last: who starts meanwhile goes by it
        return False

    def _give_back(self, seen: Dict[str, Any]) -> None:
        """Set what of a tree of parameters the master has not; a group of which it has nothing, at once."""
        master = impatient_proxy(self._uri, TIMEOUT)

        def complete(seen: Dict[str, Any], there: Any, path: str) -> None:
            for name, value in seen.items():
                if not isinstance(there, dict) or name not in there:
                    self._ask(master.setParam, path + name, value)
                elif isinstance(value, dict):
                    complete(value, there[name], f"{path}{name}/")

        complete(seen, self._ask(master.getParam, "/")[1], "/")

    def _ask(self, call: Callable[..., Any], *arguments: Any) -> Tuple[bool, Any]:
        """Return whether the master could say, and what it said.

        Where somebody sets a parameter while rosmaster writes its answer, that answer is a fault: it is asked again.
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
    """Return what of a tree of parameters lies below a node's name, as a tree from the root on; {} where nothing."""
    group, *rest = name.strip("/").split("/", 1)
    if group not in tree:
        return {}
    if not rest:
        return {group: tree[group]}
    below = part_of(tree[group], rest[0]) if isinstance(tree[group], dict) else {}
    return {group: below} if below else {}
