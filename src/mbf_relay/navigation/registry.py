"""The plugins in a user's lists: each is made at start, and once more for each concurrency slot that uses it."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, Generic, Hashable, List, Mapping, Optional, Tuple, Type, TypeVar

from mbf_relay.navigation.worker import Job, Worker
from mbf_relay.plugins import Plugin, PluginError, create, failure_text, find_class

P = TypeVar("P", bound=Plugin)

FIRST_INSTANCE: Hashable = 0
"""Key of the instances made at start: slot 0 of each action."""


class PluginInstance(Generic[P]):
    """A plugin whose calls never overlap.

    Calls are started by the thread that steps navigation, and by a service's thread where instance and slot share a
    plugin that can be made only once; new parameters come from any thread.

    Args:
        plugin: The plugin.
        worker: Runs the calls.
        costmap: The costmap it works on: "global" or "local".
        kind: Name of the plugin's list, passed on to the worker.
    """

    def __init__(self, plugin: P, worker: Worker, costmap: str, kind: str) -> None:
        self.plugin = plugin
        self.costmap = costmap
        self._kind = kind
        self._worker = worker
        self._job: Optional[Job] = None
        self._inside = threading.Lock()  # held during each call
        self._wanted: Deque[Any] = deque(maxlen=1)  # the newest parameters, until they are applied

    @property
    def name(self) -> str:
        """The plugin's name."""
        return self.plugin.name

    @property
    def busy(self) -> bool:
        """Return whether the last call has not returned yet, even if it was given up."""
        return self._job is not None and not self._job.done

    def call(self, task: Callable[[P], Any]) -> Job:
        """Run `task` with the plugin on the worker; it waits there for a running call, so ask `busy` first."""
        self._job = self._worker.start(lambda: self._run(task), self._kind)
        return self._job

    def failure_text(self, error: Exception) -> str:
        """Return an exception of a call as text, with file and line in the plugin's module."""
        return failure_text(error, type(self.plugin).__module__)

    def reconfigure(self, parameters: Any) -> None:
        """Apply new parameters before the next call, or at once when the plugin is idle; from any thread.

        This does not make the plugin `busy`.
        """
        self._wanted.append(parameters)
        self._worker.start(self._take_up_if_idle, self._kind)

    def _take_up_if_idle(self) -> None:
        if self._inside.acquire(blocking=False):
            try:
                self._take_up()
            finally:
                self._inside.release()

    def _take_up(self) -> None:
        """Apply waiting parameters; `_inside` must be held."""
        if self._wanted:
            self.plugin.reconfigure(self._wanted.pop())

    def _run(self, task: Callable[[P], Any]) -> Any:
        with self._inside:
            self._take_up()
            return task(self.plugin)


class Registry(Generic[P]):
    """All plugins of one kind by name.

    Args:
        kind: Name of the list in the parameter file, for messages: "planners", "controllers", "recovery_behaviors".
        config: The server's parameters: the list under `kind` and each plugin's group under its name.
        base: Base class of the plugins.
        known: Full class name by type name.
        worker: Runs the calls.
        costmap: Default costmap of the plugins: "global" or "local".

    A plugin of unknown type or with wrong parameters does not affect the others; `choose` and `instance` refuse it.

    Attributes:
        failed: Why a plugin could not be made, by its name.

    Raises:
        PluginError: The list has an invalid entry, or a name twice; the text says which.
    """

    def __init__(
        self,
        kind: str,
        config: Mapping[str, Any],
        base: Type[P],
        known: Mapping[str, str],
        worker: Worker,
        costmap: str,
    ) -> None:
        self.kind, self._base, self._known, self._worker = kind, base, known, worker
        self._entries = entries_of(kind, config.get(kind, []), costmap)
        self._config, self._costmap = config, costmap
        self._parameters: Dict[str, Any] = {}
        self._instances: Dict[Tuple[str, Hashable], PluginInstance[P]] = {}
        self.failed: Dict[str, str] = {}
        for name in self._entries:
            try:
                self.instance(name, FIRST_INSTANCE)
            except PluginError as error:
                self.failed[name] = str(error)

    @property
    def names(self) -> List[str]:
        """The names of the plugins that could be made, in the user's order."""
        return [name for name in self._entries if name not in self.failed]

    def values(self, name: str) -> Mapping[str, Any]:
        """Return a plugin's parameters as the user gave them; errors as for `values_of`."""
        return values_of(self._config, name, self.class_of(name))

    def type_of(self, name: str) -> str:
        """Return a plugin's type as given in the list."""
        return self._entries[name][0]

    def class_of(self, name: str) -> Type[P]:
        """Return the class of that type; PluginError where there is none."""
        return find_class(self.type_of(name), self._base, self._known)

    def plugin(self, name: str) -> P:
        """Return the plugin made at start."""
        return self.instance(name, FIRST_INSTANCE).plugin

    def choose(self, name: str) -> str:
        """Return `name`, or the first one where it is empty.

        Raises:
            PluginError: There is none of that name, or it could not be made; the text says which there are, or why.
        """
        if not self._entries:
            raise PluginError(f"No plugins loaded at all: the list '{self.kind}' is empty; name one there")
        chosen = name or next(iter(self._entries))
        if chosen in self.failed:
            raise PluginError(f'No plugin loaded with the given name "{chosen}"! {self.failed[chosen]}')
        if chosen not in self._entries:
            raise PluginError(
                f'No plugin loaded with the given name "{name}"! {self.kind}: {", ".join(self.names)}'
            )
        return chosen

    def instance(self, name: str, slot: Hashable) -> PluginInstance[P]:
        """Return a slot's instance of the plugin `name`, made if need be, so that slots do not wait for each other.

        Where a second instance cannot be made, as of a plugin that offers a service, slots share the first one, as in
        Move Base Flex; not so for controllers, which keep a path.

        Raises:
            PluginError: It cannot be made.
        """
        if (name, slot) not in self._instances:
            try:
                self._instances[name, slot] = self._make(name)
            except PluginError:
                first = self._instances.get((name, FIRST_INSTANCE))
                if first is None or self.kind == "controllers":
                    raise
                self._instances[name, slot] = first
        return self._instances[name, slot]

    def _make(self, name: str) -> PluginInstance[P]:
        type_name, costmap = self._entries[name]
        plugin = create(name, type_name, self.values(name), self._base, self._known)
        if name in self._parameters:
            plugin.reconfigure(self._parameters[name])
        return PluginInstance(plugin, self._worker, costmap, self.kind)

    def add(self, name: str, type_name: str) -> None:
        """Add a plugin with the parameters under its name, or try again to make one that failed.

        Raises:
            PluginError: It cannot be made; the registry is then unchanged.
        """
        before, self._entries = self._entries, {**self._entries, name: (type_name, self._costmap)}
        try:
            self.instance(name, FIRST_INSTANCE)
        except PluginError:
            self._entries = before
            raise
        self.failed.pop(name, None)

    def reconfigure(self, name: str, parameters: Any) -> None:
        """Give all instances of a plugin new parameters."""
        self._parameters[name] = parameters
        instances = {id(instance): instance for (of, _slot), instance in list(self._instances.items()) if of == name}
        for instance in instances.values():
            instance.reconfigure(parameters)


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


def group_of(config: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the group of parameters under a plugin's name, empty where there is none.

    As in ROS, "navfn/NavfnROS" is the group NavfnROS within the group navfn; in a file it may be written either way.

    Raises:
        PluginError: There is a value of that name instead of a group.
    """
    values: Mapping[str, Any] = {}
    for found in (_descend(config, name.split("/")), config.get(name)):
        if found is not None and not isinstance(found, Mapping):
            raise PluginError(f"parameter {name} is {found!r}; it must be the group of plugin '{name}''s parameters")
        values = {**values, **(found or {})}
    return values


def values_of(config: Mapping[str, Any], name: str, kind: Type[Plugin]) -> Mapping[str, Any]:
    """Return the parameters under a plugin's name, completed from the group that its class `reads_also`.

    Raises:
        PluginError: There is a value of that name instead of a group.
    """
    own, beside = group_of(config, name), config.get(kind.reads_also)
    if not isinstance(beside, Mapping):
        return own
    lacking = {key: value for key, value in kind.Parameters.known(beside).items()
               if key not in kind.Parameters.known(own)}
    return {**lacking, **own}


def _descend(config: Any, names: List[str]) -> Any:
    for name in names:
        if not isinstance(config, Mapping):
            return None
        config = config.get(name)
    return config
