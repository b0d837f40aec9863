"""The three lists of plugins in a server's parameters, with the base class and the known types of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Mapping, Tuple, Type, TypeVar

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.worker import Worker
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Planner
from mbf_relay.plugins import Plugin
from mbf_relay.recovery import RECOVERIES
from mbf_relay.recovery.recovery import Recovery

P = TypeVar("P", bound=Plugin)


@dataclass(frozen=True)
class PluginList(Generic[P]):
    """One list.

    Attributes:
        kind: Name of the list's parameter.
        base: Base class of its plugins.
        known: Full class name by type name.
        costmap: Default costmap of its plugins: "global" or "local".
    """

    kind: str
    base: Type[P]
    known: Mapping[str, str]
    costmap: str

    def registry(self, config: Mapping[str, Any], worker: Worker) -> Registry[P]:
        """Make the plugins that a server's parameters list; errors as for Registry."""
        return Registry(self.kind, config, self.base, self.known, worker, self.costmap)


PLANNER_LIST: PluginList[Planner] = PluginList("planners", Planner, PLANNERS, "global")
CONTROLLER_LIST: PluginList[Controller] = PluginList("controllers", Controller, CONTROLLERS, "local")
RECOVERY_LIST: PluginList[Recovery] = PluginList("recovery_behaviors", Recovery, RECOVERIES, "global")
PLUGIN_LISTS: Tuple[PluginList[Any], ...] = (PLANNER_LIST, CONTROLLER_LIST, RECOVERY_LIST)
