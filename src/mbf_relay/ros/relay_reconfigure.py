"""move_base's own parameters, and what they are called at the Move Base Flex server.

The server has settings of its own. What a user set for move_base is forwarded, what merely stands at its default is
not: a relay that starts, or starts again, must not undo the server's configuration.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.msg import Config
from dynamic_reconfigure.srv import Reconfigure

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.ros import reconfigure

SERVER_NAMES: Mapping[str, str] = {
    "planner_frequency": "planner_frequency",
    "controller_frequency": "controller_frequency",
    "planner_patience": "planner_patience",
    "controller_patience": "controller_patience",
    "max_planning_retries": "planner_max_retries",
    "recovery_behavior_enabled": "recovery_enabled",
    "shutdown_costmaps": "shutdown_costmaps",
    "oscillation_timeout": "oscillation_timeout",
    "oscillation_distance": "oscillation_distance",
}
"""move_base's parameters that the server has, with the server's names."""

WITHOUT_COUNTERPART = ("conservative_reset_dist", "clearing_rotation_allowed", "make_plan_clear_costmap")
"""move_base's parameters that the server has nothing like; its recovery behaviours are configured on the server."""

OTHER_MOVE_BASE_NAMES: List[str] = ["recovery_behaviors", "clearing_radius", "aggressive_reset_distance", "restore_defaults"]
"""Further names that move_base reads and that mean nothing here."""


RETRY_AFTER = 1.0
"""Wall time (s) after which a change the server did not take is sent again."""


@dataclass(frozen=True)
class MoveBaseParameters(ParameterSet):
    """The parameters of the node move_base, with its defaults."""

    base_global_planner: str = parameter("navfn/NavfnROS", "type of the global planner")
    base_local_planner: str = parameter("base_local_planner/TrajectoryPlannerROS", "type of the local planner")
    planner_frequency: float = parameter(0.0, "rate of replanning, 0 to plan when needed", unit="Hz", minimum=0.0, maximum=100.0)
    controller_frequency: float = parameter(20.0, "rate of the control loop", unit="Hz", minimum=0.0, maximum=100.0)
    planner_patience: float = parameter(5.0, "time without a plan before recovery", unit="s", minimum=0.0, maximum=100.0)
    controller_patience: float = parameter(5.0, "time without a command before recovery", unit="s", minimum=0.0, maximum=100.0)
    max_planning_retries: int = parameter(-1, "planning retries before recovery, -1 for no limit", minimum=-1, maximum=1000)
    conservative_reset_dist: float = parameter(
        3.0, "distance beyond which costmaps are cleared", unit="m", minimum=0.0, maximum=50.0)
    recovery_behavior_enabled: bool = parameter(True, "run recovery behaviours")
    clearing_rotation_allowed: bool = parameter(True, "turn in place to clear space")
    shutdown_costmaps: bool = parameter(False, "stop the costmaps while idle")
    oscillation_timeout: float = parameter(0.0, "time of oscillation before recovery, 0 for ever", unit="s", minimum=0.0, maximum=60.0)
    oscillation_distance: float = parameter(0.5, "motion that ends oscillation", unit="m", minimum=0.0, maximum=10.0)
    make_plan_clear_costmap: bool = parameter(True, "clear the global costmap around the robot in make_plan")
    make_plan_add_unreachable_goal: bool = parameter(True, "end make_plan's plan with the goal though it is unreachable")


def server_changes(old: MoveBaseParameters, new: MoveBaseParameters) -> Dict[str, Any]:
    """Return what to change at the server, by its names, when move_base's parameters go from `old` to `new`."""
    return {
        server_name: getattr(new, name)
        for name, server_name in SERVER_NAMES.items()
        if getattr(old, name) != getattr(new, name)
    }


def plugin_name(wanted: str, plugins: Sequence[Mapping[str, str]]) -> Optional[str]:
    """Return the server's name for the plugin that move_base calls by its type, None where it has none such.

    Args:
        wanted: A type such as "navfn/NavfnROS", or one of the server's names.
        plugins: The server's list: name and type each.
    """
    for plugin in plugins:
        if wanted in (plugin["name"], plugin["type"]):
            return plugin["name"]
    return None


class MoveBaseSettings:
    """move_base's parameters in force: offered for change, forwarded to the server, and shown as the server has them.

    A worker thread talks to the server, so that neither goals nor dynamic_reconfigure wait for it; `_lock` guards what
    it shares with their threads.
    """

    def __init__(self, server: str, values: MoveBaseParameters) -> None:
        """Start with what the parameter server held; what differs from move_base's defaults was somebody's wish.

        Args:
            server: Name of the server's node.
            values: The parameters in force.
        """
        defaults = MoveBaseParameters()
        self.values = self._started_with = values
        self._server = rospy.resolve_name(server)
        self._planner = values.base_global_planner if values.base_global_planner != defaults.base_global_planner else ""
        self._controller = values.base_local_planner if values.base_local_planner != defaults.base_local_planner else ""
        self._lock = threading.Lock()
        self._wanted = server_changes(defaults, values)
        self._to_send = dict(self._wanted)
        self._wake = threading.Event()
        self._front: Any = None
        self._plugins: Dict[str, List[Mapping[str, str]]] = {}

    def serve(self) -> None:
        """Offer the parameters for change and follow the server's."""
        from mbf_relay.cfg import MoveBaseConfig

        self._front = reconfigure.serve(MoveBaseConfig, self.values, self._change, defaults=lambda: self._started_with)
        rospy.Subscriber(f"{self._server}/parameter_updates", Config, self._mirror)
        threading.Thread(target=self._forward, name="forward to server", daemon=True).start()
        rospy.on_shutdown(self._forget_shown)

    def server_came(self) -> None:
        """Send the server, which starts with its own configuration, what was wished for."""
        with self._lock:
            self._plugins.clear()
            self._to_send = dict(self._wanted)
        self._wake.set()
        self.plugin_names()  # asks the master now, not when the first goal comes

    def plugin_names(self) -> Tuple[str, str]:
        """Return the server's names of the planner and controller to use, empty for its first."""
        return self._name("planners", self._planner), self._name("controllers", self._controller)

    def server_name(self, kind: str, name: str) -> str:
        """Return what the server calls the plugin whose topics move_base has under `name`, a class such as NavfnROS.

        Args:
            kind: "planners" or "controllers".
            name: The last part of the plugin's type.
        """
        plugins = server_plugins(self._server, kind)
        for plugin in plugins:
            if plugin["type"].rsplit("/", 1)[-1] == name:
                return plugin["name"]
        return name

    def _name(self, kind: str, wanted: str) -> str:
        if not wanted:
            return ""
        if kind not in self._plugins:
            self._plugins[kind] = server_plugins(self._server, kind)
            if plugin_name(wanted, self._plugins[kind]) is None:
                rospy.logwarn("%s", _no_such_plugin(wanted, self._plugins[kind], self._server))
        return plugin_name(wanted, self._plugins[kind]) or ""

    def _change(self, new: MoveBaseParameters) -> None:
        """Take new values from dynamic_reconfigure.

        Raises:
            ValueError: The server has no such plugin; move_base too refuses one it cannot load.
        """
        old = self.values
        for name, kind in (("base_global_planner", "planners"), ("base_local_planner", "controllers")):
            wanted = getattr(new, name)
            if wanted != getattr(old, name):
                plugins = server_plugins(self._server, kind)
                if plugin_name(wanted, plugins) is None:
                    raise ValueError(_no_such_plugin(wanted, plugins, self._server))
                setattr(self, "_planner" if kind == "planners" else "_controller", wanted)
        for name in WITHOUT_COUNTERPART:
            if getattr(new, name) != getattr(old, name):
                rospy.logwarn("%s has no counterpart at the server; configure its recovery behaviours instead", name)
        changes = server_changes(old, new)
        with self._lock:
            self.values = new
            self._wanted.update(changes)
            self._to_send.update(changes)
        self._wake.set()

    def _mirror(self, message: Config) -> None:
        """Show the server's values, except where a wish is still on its way there."""
        theirs = decode_config(message)
        with self._lock:
            shown = {
                name: theirs[server_name] for name, server_name in SERVER_NAMES.items()
                if server_name in theirs and server_name not in self._to_send
            }
            try:
                values = self.values.replace(**shown)
            except ValueError as error:
                rospy.logwarn("the server's settings are not move_base's: %s", error)
                return
            untouched = {name: value for name, value in shown.items() if SERVER_NAMES[name] not in self._wanted}
            self._started_with = self._started_with.replace(**untouched)
            changed, self.values = values != self.values, values
        if changed:
            self._front.update_configuration(shown)

    def _forget_shown(self) -> None:
        """Take what only shows the server's values off the parameter server, where dynamic_reconfigure put it.

        The next relay of this master would take it for wishes, and undo what was changed in the server's own file.
        """
        for name, server_name in SERVER_NAMES.items():
            if server_name not in self._wanted:
                try:
                    rospy.delete_param(f"~{name}")
                except (KeyError, OSError, rospy.ROSException):
                    pass  # it was never put there, or the master has ended first

    def _forward(self) -> None:
        """Send wishes as they come; where the server is not there, keep them."""
        service = rospy.ServiceProxy(f"{self._server}/set_parameters", Reconfigure)
        while not rospy.is_shutdown():
            self._wake.wait(RETRY_AFTER if self._to_send else None)
            self._wake.clear()
            with self._lock:
                changes, self._to_send = self._to_send, {}
            if not changes:
                continue
            try:
                service(encode_config(changes))
                rospy.loginfo("forwarded to %s: %s", self._server, changes)
            except (rospy.ServiceException, rospy.ROSException):
                with self._lock:
                    self._to_send = {**changes, **self._to_send}


def tell_of_misplaced(values: Mapping[str, Any], server: str) -> None:
    """Say in the log which of move_base's parameters, costmaps' and plugins', the server has to be given instead."""
    groups = sorted(name for name, value in values.items() if isinstance(value, Mapping) or name == "recovery_behaviors")
    if groups:
        rospy.logwarn("of no use to the relay, load them for %s: %s", rospy.resolve_name(server), ", ".join(groups))


def server_plugins(server: str, kind: str) -> List[Mapping[str, str]]:
    """Return the server's list of planners or controllers, empty where there is none."""
    plugins = rospy.get_param(f"{server}/{kind}", [])
    return [p for p in plugins if isinstance(p, Mapping) and "name" in p and "type" in p]


def _no_such_plugin(wanted: str, plugins: Sequence[Mapping[str, str]], server: str) -> str:
    known = ", ".join(f"{p['name']} ({p['type']})" for p in plugins) or "none"
    return f"{server} has no plugin '{wanted}'; it has: {known}"
