"""The plugins a user's lists name, made once each, and once more for every concurrency slot that asks for its own."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, Generic, Hashable, List, Mapping, Optional, Tuple, Type, TypeVar

from mbf_relay.navigation.worker import Job, Worker
from mbf_relay.plugins import Plugin, PluginError, create, failure_text, find_class

P = TypeVar("P", bound=Plugin)

FIRST_INSTANCE: Hashable = 0
"""The instance of the plugins made at start: slot 0 of each action."""


class PluginInstance(Generic[P]):
    """One plugin and the calls into it, which never overlap.

    Calls are made by the thread that steps navigation, and by a service's where the plugin can be made once only; new
    parameters come from any.

    Args:
        plugin: The plugin.
        worker: Runs the calls.
        costmap: Which one it works on: "global" or "local".
        kind: The list the plugin stands in, for the worker.
    """

    def __init__(self, plugin: P, worker: Worker, costmap: str, kind: str) -> None:
        self.plugin = plugin
        self.costmap = costmap
        self._kind = kind
        self._worker = worker
        self._job: Optional[Job] = None
        self._inside = threading.Lock()  # held by who is in the plugin
        self._wanted: Deque[Any] = deque(maxlen=1)  # the newest parameters, until it has taken them

    @property
    def name(self) -> str:
        """The plugin's name."""
        return self.plugin.name

    @property
    def busy(self) -> bool:
        """Return whether a call is still in the plugin, be it one that was given up."""
        return self._job is not None and not self._job.done

    def call(self, task: Callable[[P], Any]) -> Job:
        """Run `task` with the plugin on the worker, after the call that is in it; whoever minds asks first."""
        self._job = self._worker.start(lambda: self._run(task), self._kind)
        return self._job

    def failure_text(self, error: Exception) -> str:
        """Return what an exception that came out of a call says, with its place in the plugin's module."""
        return failure_text(error, type(self.plugin).__module__)

    def reconfigure(self, parameters: Any) -> None:
        """Give the plugin new parameters before its next call, or at once when it is idle; from any thread.

        That is no call: whoever looked whether the plugin is busy a moment ago may call it all the same.
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
        """Have the plugin take what is wanted of it; only while it is held."""
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
        config: The server's parameters: the list under `kind` and each plugin's own under its name.
        base: What the plugins derive from.
        known: Type names and the classes that do that job here.
        worker: Runs the calls.
        costmap: The costmap of plugins that name none: "global" or "local".

    A plugin of unknown type or with wrong parameters leaves the others alone: it is refused to whoever asks for it.

    Attributes:
        failed: Why a plugin could not be made, by its name.

    Raises:
        PluginError: The list is no list of names and types, or holds a name twice; the text says which.
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
        """Return a plugin's parameters as the user gave them; see `values_of`, with its errors."""
        return values_of(self._config, name, self.class_of(name))

    def type_of(self, name: str) -> str:
        """Return the type a plugin was asked for by."""
        return self._entries[name][0]

    def class_of(self, name: str) -> Type[P]:
        """Return the class that type stands for."""
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
        """Return the plugin `name` of a slot; each slot has one of its own, so that slots do not wait for each other.

        One that can be made once only, as where it offers a service, is shared by all, as in Move Base Flex; but for
        controllers, whose path would be that of whoever came last.

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
        """Make one more plugin, with the parameters under its name, or try again to make one that failed.

        Raises:
            PluginError: It cannot be made; everything is as it was then.
        """
        before, self._entries = self._entries, {**self._entries, name: (type_name, self._costmap)}
        try:
            self.instance(name, FIRST_INSTANCE)
        except PluginError:
            self._entries = before
            raise
        self.failed.pop(name, None)

    def reconfigure(self, name: str, parameters: Any) -> None:
        """Give a plugin new parameters, in every slot."""
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
    """Return the group of parameters that stands under a plugin's name, empty where there is none.

    As in ROS, "navfn/NavfnROS" is the group NavfnROS within the group navfn; in a file it may be written either way.

    Raises:
        PluginError: What stands there is no group.
    """
    values: Mapping[str, Any] = {}
    for found in (_descend(config, name.split("/")), config.get(name)):
        if found is not None and not isinstance(found, Mapping):
            raise PluginError(f"parameter {name} is {found!r}; it must be the group of plugin '{name}''s parameters")
        values = {**values, **(found or {})}
    return values


def values_of(config: Mapping[str, Any], name: str, kind: Type[Plugin]) -> Mapping[str, Any]:
    """Return the parameters under a plugin's name, and what they lack of its class's that the group beside has.

    Raises:
        PluginError: What stands under its name is no group.
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
