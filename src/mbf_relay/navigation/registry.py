"""The plugins a user's lists name, made once each, and one more for every concurrency slot that asks for its own."""

from __future__ import annotations

from typing import Any, Callable, Dict, Generic, Hashable, List, Mapping, Optional, Tuple, Type, TypeVar

from mbf_relay.navigation.worker import Job, Worker
from mbf_relay.plugins import Plugin, PluginError, create, find_class

P = TypeVar("P", bound=Plugin)

FIRST_SEAT: Hashable = 0
"""The seat of the plugins made at start: slot 0 of each action."""


class Seat(Generic[P]):
    """One plugin and the calls into it, which never overlap."""

    def __init__(self, plugin: P, worker: Worker, costmap: str) -> None:
        self.plugin = plugin
        self.costmap = costmap
        self._worker = worker
        self._job: Optional[Job] = None
        self._wanted: Any = None

    @property
    def name(self) -> str:
        """The plugin's name."""
        return self.plugin.name

    @property
    def busy(self) -> bool:
        """Tell whether a call is still in the plugin, be it one that was given up."""
        return self._job is not None and not self._job.done

    def call(self, task: Callable[[P], Any]) -> Job:
        """Run `task` with the plugin on the worker; only while not busy."""
        if self.busy:
            raise RuntimeError(f"plugin '{self.name}' is still in an earlier call")
        self._job = self._worker.start(lambda: self._run(task))
        return self._job

    def reconfigure(self, parameters: Any) -> None:
        """Give the plugin new parameters before its next call, or at once when it is idle."""
        self._wanted = parameters
        if not self.busy:
            self.call(lambda plugin: None)

    def _run(self, task: Callable[[P], Any]) -> Any:
        wanted, self._wanted = self._wanted, None
        if wanted is not None:
            self.plugin.reconfigure(wanted)
        return task(self.plugin)


class Registry(Generic[P]):
    """All plugins of one kind by name.

    Args:
        kind: Name of the list in the parameter file, for messages: "planners", "controllers", "recovery_behaviors".
        config: The server's parameters: the list under `kind` and each plugin's own under its name.
        base: What the plugins derive from.
        known: Type names and the classes that do that job here.
        worker: Runs the calls.
        costmap: The costmap of plugins that name none: "global" or "local".

    Raises:
        PluginError: The list is no list of names and types, holds a name twice or an unknown type, or a plugin's
            parameters are wrong; the text says which.
    """

    def __init__(
        self, kind: str, config: Mapping[str, Any], base: Type[P], known: Mapping[str, str], worker: Worker, costmap: str
    ) -> None:
        self.kind, self._base, self._known, self._worker = kind, base, known, worker
        self._entries = entries_of(kind, config.get(kind, []), costmap)
        self._values = {name: _values_of(config, name) for name in self._entries}
        self._parameters: Dict[str, Any] = {}
        self._seats: Dict[Tuple[str, Hashable], Seat[P]] = {}
        for name in self._entries:
            self.seat(name, FIRST_SEAT)

    @property
    def names(self) -> List[str]:
        """The plugins' names in the user's order."""
        return list(self._entries)

    def type_of(self, name: str) -> str:
        """Return the type a plugin was asked for by."""
        return self._entries[name][0]

    def class_of(self, name: str) -> Type[P]:
        """Return the class that type stands for."""
        return find_class(self.type_of(name), self._base, self._known)

    def plugin(self, name: str) -> P:
        """Return the plugin made at start."""
        return self.seat(name, FIRST_SEAT).plugin

    def choose(self, name: str) -> str:
        """Return `name`, or the first one where it is empty.

        Raises:
            PluginError: There is none of that name; the text says which there are.
        """
        if name in self._entries:
            return name
        if not self._entries:
            raise PluginError(f"No plugins loaded at all: the list '{self.kind}' is empty")
        if name:
            raise PluginError(
                f'No plugin loaded with the given name "{name}"! {self.kind}: {", ".join(self._entries)}'
            )
        return next(iter(self._entries))

    def seat(self, name: str, slot: Hashable) -> Seat[P]:
        """Return the plugin `name` of a slot; each slot has one of its own, so that slots do not wait for each other."""
        if (name, slot) not in self._seats:
            type_name, costmap = self._entries[name]
            plugin = create(name, type_name, self._values[name], self._base, self._known)
            if name in self._parameters:
                plugin.reconfigure(self._parameters[name])
            self._seats[name, slot] = Seat(plugin, self._worker, costmap)
        return self._seats[name, slot]

    def reconfigure(self, name: str, parameters: Any) -> None:
        """Give a plugin new parameters, in every slot."""
        self._parameters[name] = parameters
        for (seat_name, _slot), seat in list(self._seats.items()):
            if seat_name == name:
                seat.reconfigure(parameters)


def entries_of(kind: str, entries: Any, costmap: str) -> Dict[str, Tuple[str, str]]:
    """Return name -> (type, costmap) of a user's plugin list.

    Raises:
        PluginError: See `Registry`.
    """
    if not isinstance(entries, (list, tuple)):
        raise PluginError(f"parameter {kind} is {entries!r}; it must be a list like [{{name: A, type: B}}]")
    result: Dict[str, Tuple[str, str]] = {}
    for index, entry in enumerate(entries):
        if not isinstance(entry, Mapping) or not all(isinstance(entry.get(key), str) for key in ("name", "type")):
            raise PluginError(f"entry {index} of {kind} is {entry!r}; it must have a name and a type, both texts")
        name, wanted = entry["name"], entry.get("costmap", costmap)
        if not name:
            raise PluginError(f"entry {index} of {kind} has an empty name")
        if name in result:
            raise PluginError(f"{kind} names '{name}' twice; names must differ, as parameters stand under them")
        if wanted not in ("global", "local"):
            raise PluginError(f"{kind}: plugin '{name}' asks for costmap {wanted!r}; it must be 'global' or 'local'")
        result[name] = (entry["type"], wanted)
    return result


def _values_of(config: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    values = config.get(name) or {}
    if not isinstance(values, Mapping):
        raise PluginError(f"parameter {name} is {values!r}; it must be the group of plugin '{name}''s parameters")
    return values
