"""dynamic_reconfigure of move_base's own parameters, where the server is in the same process."""

from __future__ import annotations

from typing import Any, Mapping, Tuple

import rospy

from mbf_relay.navigation.move_base_files import (
    PLUGIN_PARAMETERS,
    adapted,
    default_recoveries,
    lists_recoveries,
    server_values,
)
from mbf_relay.navigation.move_base_parameters import MoveBaseParameters
from mbf_relay.plugins import plugin_name
from mbf_relay.ros.common import reconfigure
from mbf_relay.ros.relay.reconfigure import WITHOUT_COUNTERPART
from mbf_relay.ros.server.node import MoveBaseFlex


class OwnSettings:
    """Offers move_base's parameters by dynamic_reconfigure and applies changes to the server in this process.

    Attributes:
        values: The parameters in force.
        recoveries: Names of move_base's default recovery behaviours, in order; empty where the user lists his own.
        knows_server: Whether the names of the server's plugins are known; here they always are.
    """

    knows_server = True

    def __init__(self, values: MoveBaseParameters, namespace: Mapping[str, Any]) -> None:
        """Start with the values on the parameter server.

        Args:
            values: move_base's own parameters.
            namespace: All parameters in the node's private namespace, with the plugins' groups.
        """
        self.values, self._namespace = values, namespace
        self.recoveries: Tuple[str, ...] = () if lists_recoveries(namespace) else default_recoveries(values)
        self._server: Any = None

    def serve(self, server: MoveBaseFlex) -> None:
        """Start the dynamic_reconfigure server; changes are applied to `server`."""
        from mbf_relay.cfg import MoveBaseConfig

        self._server = server
        reconfigure.serve(MoveBaseConfig, self.values, self._change)

    def plugin_names(self) -> Tuple[str, str]:
        """Return the server's names of the planner and the controller in use."""
        planner, controller = self.values.base_global_planner, self.values.base_local_planner
        return plugin_name(adapted(planner, self._namespace)), plugin_name(adapted(controller, self._namespace))

    def _change(self, new: MoveBaseParameters) -> None:
        """Apply new values from dynamic_reconfigure.

        Raises:
            ValueError: A plugin of that type cannot be made.
        """
        old = self.values
        for kind, name in PLUGIN_PARAMETERS.items():
            if getattr(new, name) != getattr(old, name):
                type_name = adapted(getattr(new, name), self._namespace)
                self._server.add_plugin(kind, plugin_name(type_name), type_name)
        for name in WITHOUT_COUNTERPART:
            if getattr(new, name) != getattr(old, name):
                rospy.logwarn("%s takes effect at the next start", name)
        retries = {"controller_max_retries": self._namespace.get("controller_max_retries", -1)}
        before, wanted = ({**retries, **server_values(values)} for values in (old, new))
        changes = {name: value for name, value in wanted.items() if value != before[name]}
        if changes:
            parameters, _notes = type(self._server.navigator.parameters).read(
                {**self._server.navigator.parameters.as_dict(), **changes})
            self._server.reconfigure(parameters)
        self.values = new
