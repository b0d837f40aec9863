"""move_base's own parameters, forwarded to the Move Base Flex server under the server's names.

Only values that a user set for move_base are forwarded, not defaults: the server has its own configuration, which a
relay that starts, or is restarted, must not overwrite.
"""

from __future__ import annotations

import threading
from types import MappingProxyType
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.msg import Config
from dynamic_reconfigure.srv import Reconfigure

from mbf_relay.navigation.move_base_files import PLUGIN_PARAMETERS, SERVER_NAMES, server_values
from mbf_relay.navigation.move_base_parameters import MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.plugins import plugin_name
from mbf_relay.ros.common import reconfigure
from mbf_relay.ros.common.impatient_proxy import NO_ANSWER

WITHOUT_COUNTERPART = ("conservative_reset_dist", "clearing_rotation_allowed", "make_plan_clear_costmap")
"""move_base's parameters without a counterpart at the server, where recovery behaviours are configured separately."""

MIRRORED = "mirrored"
"""Parameter with a copy of those values that only show the server's; the next relay must not take them for a user's."""
RETRY_AFTER = 1.0
"""Wall time (s) after which a change that did not reach the server is sent again."""


def wishes(values: Mapping[str, Any]) -> Dict[str, Any]:
    """Return the node's parameters as set by users, without those that a killed relay has left to show the server's."""
    mirrored = values.get(MIRRORED, {})
    mirrored = mirrored if isinstance(mirrored, Mapping) else {}
    return {
        name: value for name, value in values.items()
        if name != MIRRORED and not (name in mirrored and mirrored[name] == value)
    }


def server_changes(old: MoveBaseParameters, new: MoveBaseParameters) -> Dict[str, Any]:
    """Return what to change at the server, by its names, when move_base's parameters change from `old` to `new`."""
    retries = {"controller_max_retries": NavigatorParameters.controller_max_retries}  # which move_base has no name for
    before, wanted = ({**retries, **server_values(values)} for values in (old, new))
    changed = {SERVER_NAMES[name] for name in SERVER_NAMES if getattr(old, name) != getattr(new, name)}
    return {name: value for name, value in wanted.items() if name in changed or value != before[name]}


def name_at_server(wanted: str, plugins: Sequence[Mapping[str, str]]) -> Optional[str]:
    """Return the server's name of the plugin that move_base names by its type, None where it has none.

    Args:
        wanted: A type such as "navfn/NavfnROS", or one of the server's names.
        plugins: The server's list; each entry has a name and a type.
    """
    for plugin in plugins:
        if wanted in (plugin["name"], plugin["type"]):
            return plugin["name"]
    return None


class MoveBaseSettings:
    """move_base's parameters: its dynamic_reconfigure server, forwarding to the server, and following its changes.

    A thread talks to the server, so that neither goals nor dynamic_reconfigure wait for it; `_lock` guards what it
    shares with other threads. "Wishes" are the values that users set, by the server's names.
    """

    recoveries: Tuple[str, ...] = ()
    """The order of recovery behaviours: that of the server's list."""

    def __init__(self, server: str, values: MoveBaseParameters) -> None:
        """Start with the values on the parameter server; those that differ from move_base's defaults are wishes.

        Args:
            server: Name of the server's node.
            values: The values on the parameter server.
        """
        defaults = MoveBaseParameters()
        self.values = self._started_with = values
        self._offered = values  # as last seen by dynamic_reconfigure, which learns of the server's changes later
        self._server = rospy.resolve_name(server)
        # chosen plugin by the server's list; empty for the first of the list
        self._asked = {
            kind: getattr(values, name) if getattr(values, name) != getattr(defaults, name) else ""
            for kind, name in PLUGIN_PARAMETERS.items()
        }
        self._lock = threading.Lock()
        self._wanted = server_changes(defaults, values)
        self._to_send = dict(self._wanted)
        self._wake = threading.Event()
        self._dynamic: Any = None
        self._plugins: Dict[str, List[Mapping[str, str]]] = {}
        self._plugins_wanted = False

    def serve(self) -> None:
        """Start the dynamic_reconfigure server, and follow the server's changes."""
        from mbf_relay.cfg import MoveBaseConfig

        self._dynamic = reconfigure.serve(
            MoveBaseConfig, self.values, self._change, defaults=lambda: self._started_with
        )
        rospy.Subscriber(f"{self._server}/parameter_updates", Config, self._mirror)
        threading.Thread(target=self._forward, name="forward to server", daemon=True).start()
        rospy.on_shutdown(self._forget_shown)

    def server_came(self) -> None:
        """Send all wishes to a server that has just started, and read its lists of plugins."""
        with self._lock:
            self._to_send = dict(self._wanted)
            self._plugins_wanted = True
        self._wake.set()

    @property
    def knows_server(self) -> bool:
        """Whether the server's names of the chosen plugins are known, so that a goal can be composed."""
        asked = [kind for kind, wanted in self._asked.items() if wanted]
        return not asked or not self._plugins_wanted and all(kind in self._plugins for kind in asked)

    def plugin_names(self) -> Tuple[str, str]:
        """Return the server's names of the planner and controller to use, empty for its first; does not block."""
        return self._name("planners"), self._name("controllers")

    def server_name(self, kind: str, name: str) -> str:
        """Return the server's name of the plugin whose topics move_base has under `name`, such as NavfnROS.

        Args:
            kind: "planners" or "controllers".
            name: The last part of the plugin's type.
        """
        plugins = server_plugins(self._server, kind)
        for plugin in plugins:
            if plugin_name(plugin["type"]) == name:
                return plugin["name"]
        return name

    def _name(self, kind: str) -> str:
        return name_at_server(self._asked[kind], self._plugins.get(kind, ())) or ""

    def _learn_plugins(self) -> None:
        """Read the server's lists of plugins from the master, which may block."""
        found = {kind: server_plugins(self._server, kind) for kind in self._asked}
        for kind, wanted in self._asked.items():
            if wanted and name_at_server(wanted, found[kind]) is None:
                rospy.logwarn("%s; goals get its default", _no_such_plugin(wanted, found[kind], self._server))
        self._plugins = found

    def _change(self, new: MoveBaseParameters) -> None:
        """Take new values from dynamic_reconfigure.

        The plugin named at the start, where the server does not have it, stands for the first of the server's list.

        Raises:
            ValueError: The server has no such plugin; move_base, too, refuses one that it cannot load.
        """
        asked = {name: value for name, value in vars(new).items() if value != getattr(self._offered, name)}
        for kind, name in PLUGIN_PARAMETERS.items():
            if name in asked:
                wanted = asked[name]
                plugins = server_plugins(self._server, kind)
                if name_at_server(wanted, plugins) is None:
                    if wanted != getattr(self._started_with, name):
                        raise ValueError(_no_such_plugin(wanted, plugins, self._server))
                    wanted = ""
                self._plugins[kind], self._asked[kind] = plugins, wanted
        for name in WITHOUT_COUNTERPART:
            if name in asked:
                rospy.logwarn("%s has no counterpart at the server; configure its recovery behaviours instead", name)
        with self._lock:
            old, self.values = self.values, self.values.replace(**asked)
            changes = server_changes(old, self.values)
            self._wanted.update(changes)
            self._to_send.update(changes)
        self._offered = new
        self._wake.set()

    def _mirror(self, message: Config) -> None:
        """Take over the server's values, except where a wish has not been sent yet."""
        self._show(decode_config(message))

    def _show(self, theirs: Mapping[str, Any], refused: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Take over the server's values and show them in dynamic_reconfigure.

        Args:
            theirs: The server's values, by its names.
            refused: Wishes that the server has refused; they are dropped.
        """
        with self._lock:
            for name, value in refused.items():
                if name not in self._to_send and self._wanted.get(name) == value:
                    del self._wanted[name]
            asked_for = server_values(self.values)  # the same value by another name, such as patience 0 as 0 retries
            shown = {
                name: theirs[their] if theirs[their] != asked_for[their] else getattr(self.values, name)
                for name, their in SERVER_NAMES.items() if their in theirs and their not in self._to_send
            }
            try:
                values = self.values.replace(**shown)
            except ValueError as error:
                rospy.logwarn("the server's settings cannot be shown as move_base's parameters: %s", error)
                return
            untouched = {name: value for name, value in shown.items() if SERVER_NAMES[name] not in self._wanted}
            self._started_with = self._started_with.replace(**untouched)
            changed, self.values = values != self.values, values
        if changed or refused:
            # first, so that a relay killed in between leaves no such value unmarked
            rospy.set_param(f"~{MIRRORED}", untouched)
            self._dynamic.update_configuration(shown)

    def _forget_shown(self) -> None:
        """Delete parameters that only show the server's values, which dynamic_reconfigure has set.

        The next relay would take them for wishes and overwrite what was changed in the server's own file meanwhile.
        """
        shown = [name for name, server_name in SERVER_NAMES.items() if server_name not in self._wanted]
        for name in (*shown, MIRRORED):
            try:
                rospy.delete_param(f"~{name}")
            except (KeyError, rospy.ROSException, *NO_ANSWER):
                pass  # it was never set, or the master has ended

    def _forward(self) -> None:
        """Send wishes as they come, again and again while the server is not there."""
        service = rospy.ServiceProxy(f"{self._server}/set_parameters", Reconfigure)
        while not rospy.is_shutdown():
            self._wake.wait(RETRY_AFTER if self._to_send or self._plugins_wanted else None)
            self._wake.clear()
            self.send_wishes(service)

    def send_wishes(self, service: Callable[[Config], Any]) -> None:
        """Read the server's lists of plugins where that is due, and send the wishes not sent yet.

        Args:
            service: The server's set_parameters.
        """
        with self._lock:
            changes, self._to_send = self._to_send, {}
            learn = self._plugins_wanted
            if learn:  # forget a previous server's lists until those of this one are read
                self._plugins, self._plugins_wanted = {}, False
        try:
            if learn:
                self._learn_plugins()
            if changes:
                self._send(service, changes)
        except (rospy.ServiceException, rospy.ROSException, *NO_ANSWER):
            with self._lock:
                self._to_send = {**changes, **self._to_send}
                self._plugins_wanted |= learn

    def _send(self, service: Callable[[Config], Any], changes: Mapping[str, Any]) -> None:
        """Send wishes to the server; log and drop those it refuses."""
        theirs = decode_config(service(encode_config(changes)).config)
        refused = {name: value for name, value in changes.items() if theirs.get(name, value) != value}
        if refused and len(changes) > 1:  # a single refused value makes the server refuse the whole message
            for name, value in changes.items():
                self._send(service, {name: value})
            return
        for name, value in refused.items():
            rospy.logwarn("%s refused %s = %s and keeps %s", self._server, name, value, theirs[name])
        if refused:
            self._show(theirs, refused)
        else:
            rospy.loginfo("forwarded to %s: %s", self._server, dict(changes))


def tell_of_misplaced(values: Mapping[str, Any], server: str) -> None:
    """Warn of groups for costmaps and plugins in move_base's namespace, which must be loaded for the server instead."""
    groups = sorted(
        name for name, value in values.items() if isinstance(value, Mapping) or name == "recovery_behaviors"
    )
    if groups:
        rospy.logwarn("parameters the relay does not use, to be loaded for %s instead: %s", rospy.resolve_name(server),
                      ", ".join(groups))


def server_plugins(server: str, kind: str) -> List[Mapping[str, str]]:
    """Return one of the server's lists of plugins from the parameter server, empty where there is none."""
    plugins = rospy.get_param(f"{server}/{kind}", [])
    return [p for p in plugins if isinstance(p, Mapping) and "name" in p and "type" in p]


def _no_such_plugin(wanted: str, plugins: Sequence[Mapping[str, str]], server: str) -> str:
    known = ", ".join(f"{p['name']} ({p['type']})" for p in plugins) or "none"
    return f"{server} has no plugin '{wanted}'; it has: {known}"
