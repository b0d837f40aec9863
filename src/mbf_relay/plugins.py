"""Plugins: their base class, and their creation from the type name in a parameter file."""

from __future__ import annotations

import importlib
import inspect
import os
import traceback
import warnings
from typing import Any, ClassVar, Mapping, Optional, Tuple, Type, TypeVar

from mbf_relay.outcomes import as_told
from mbf_relay.parameters import ParameterSet


class Plugin:
    """Base class of what users can replace: planner, controller, critic, layer and recovery behaviour.

    A plugin is a class with `Parameters`, a frozen dataclass derived from ParameterSet, in a module on PYTHONPATH; its
    type in the parameter file is `package.module.Class`.

    Attributes:
        name: The name in the user's parameter file; its parameters are below that name.
        parameters: The values in force; they change only by `reconfigure`. Nobody else reads them.
        dynamic_config: The module made from a .cfg file whose parameters may be changed at run time by
            dynamic_reconfigure, such as "mbf_relay.cfg.DwaConfig"; empty where none may.
        stands_in: For a class that substitutes a plugin of another package: one sentence on what it keeps of that;
            empty for others.
        reads_also: Name of a further parameter group, in which the upstream class reads parameters that are not in its
            own; empty for none.
        notes: Lines for the log on the user's type and values that were not used as given.
    """

    Parameters: ClassVar[Type[ParameterSet]] = ParameterSet
    dynamic_config: ClassVar[str] = ""
    stands_in: ClassVar[str] = ""
    reads_also: ClassVar[str] = ""
    notes: Tuple[str, ...] = ()

    def __init__(self, name: str, parameters: Any) -> None:
        self.name = name
        self.parameters = parameters

    def reconfigure(self, parameters: Any) -> None:
        """Take new parameters at run time; override to recompute what depends on them."""
        self.parameters = parameters


P = TypeVar("P", bound=Plugin)


class StandInNote(str):
    """A note that a plugin substitutes another one, which is not available."""

    @classmethod
    def of(cls, type_name: str, does: str) -> StandInNote:
        """Return the note for a plugin type; `does` says what is done instead."""
        return cls(f"{type_name} is not available here; {does}")


class PluginFailure(RuntimeError):
    """A plugin used by another one, such as a critic or a layer, raised an exception; the text names the plugin."""


class PluginError(ValueError):
    """A plugin could not be found or created; the text names it and what is available."""


def failure_text(error: BaseException, module: str) -> str:
    """Return an exception's text with the place in the plugin's module: "KeyError: 'x' (mine.py, line 7)".

    Args:
        error: The caught exception.
        module: Full name of the plugin's module; without a frame of it in the traceback no place is given.
    """
    try:
        said = str(error)
    except Exception as second:  # __str__ of the plugin's own exception
        said = f"and what it says cannot be told for {type(second).__name__}"
    text = as_told(f"{type(error).__name__}: {said}")
    places = [
        f"{os.path.basename(frame.f_code.co_filename)}, line {line}"
        for frame, line in traceback.walk_tb(error.__traceback__) if frame.f_globals.get("__name__") == module
    ]
    return f"{text} ({places[-1]})" if places else text


class failures_of:  # a context manager; a generator would take several times as long
    """Turn whatever a plugin, a `kind` such as "critic", raises into a PluginFailure."""

    __slots__ = ("_plugin", "_kind")

    def __init__(self, plugin: Plugin, kind: str) -> None:
        self._plugin, self._kind = plugin, kind

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Optional[BaseException], place: Any) -> None:
        if isinstance(error, Exception):
            text = failure_text(error, type(self._plugin).__module__)
            raise PluginFailure(f"{self._kind} '{self._plugin.name}' failed with {text}") from error


def find_class(type_name: str, base: Type[P], known: Mapping[str, str]) -> Type[P]:
    """Return the class of a type name.

    Args:
        type_name: A key of `known` (the names upstream uses, e.g. "navfn/NavfnROS"), its last part alone, as files from
            before ROS Hydro have it, or in another package, as of a copy that somebody changed; or
            "package.module.Class".
        base: The abstract class it must derive from.
        known: Maps upstream and short names to "package.module.Class", and former names to present ones; for a former
            name a FutureWarning is given.

    Raises:
        PluginError: There is no such class, it is not derived from `base`, or it lacks an abstract method.
    """
    path = known.get(_full_name(type_name, known), type_name)
    if path in known:
        warnings.warn(
            f"{base.__name__.lower()} type '{type_name}' is called '{path}' now; write that instead", FutureWarning, 2
        )
        path = known[path]
    module_name, _, class_name = path.rpartition(".")
    available = ", ".join(sorted(known))
    if not module_name:
        raise PluginError(
            f"unknown {base.__name__.lower()} type '{type_name}'; available: {available}, "
            "or package.module.Class of your own"
        )
    try:
        found = getattr(importlib.import_module(module_name), class_name)
    except Exception as error:  # whatever a user's module does when it is run
        reason = (
            str(error)
            if isinstance(error, (ImportError, AttributeError, SyntaxError))
            else failure_text(error, module_name)
        )
        if isinstance(error, ModuleNotFoundError) and error.name == module_name.partition(".")[0]:
            reason += ": is its folder on PYTHONPATH?"
        raise PluginError(
            f"{base.__name__.lower()} type '{type_name}' cannot be loaded ({reason}); available: {available}"
        ) from error
    if not (isinstance(found, type) and issubclass(found, base)):
        raise PluginError(
            f"'{type_name}' is no {base.__name__.lower()}: it must derive from {base.__module__}.{base.__name__}"
        )
    if inspect.isabstract(found):
        missing = ", ".join(sorted(vars(found)["__abstractmethods__"]))
        raise PluginError(f"{base.__name__.lower()} type '{type_name}' does not define {missing}")
    return found


def _full_name(type_name: str, known: Mapping[str, str]) -> str:
    """Return the known name that `type_name` is, or has the last part of; itself where there is none or several."""
    if type_name in known or "." in type_name:
        return type_name
    matches = [name for name in known if plugin_name(name) == plugin_name(type_name)]
    return matches[0] if len({known[name] for name in matches}) == 1 else type_name


def plugin_name(type_name: str) -> str:
    """Return the name move_base gives a plugin: the last part of its type, under which its parameters and topics stand.
    """
    return type_name.replace("::", "/").rpartition("/")[2]


def create(name: str, type_name: str, values: Mapping[str, Any], base: Type[P], known: Mapping[str, str]) -> P:
    """Create a plugin from its name, type and parameters; values that were not used as given are in its notes.

    Raises:
        PluginError: The type is unknown, a parameter is wrong, or the constructor failed; the text names plugin and
            parameter.
    """
    found = find_class(type_name, base, known)
    try:
        parameters, notes = found.Parameters.read(values)
    except ValueError as error:
        raise PluginError(f"plugin '{name}' ({type_name}): {error}") from error
    try:
        plugin = found(name, parameters)
    except Exception as error:  # whatever a user's constructor raises
        reason = str(error) if isinstance(error, (ValueError, OSError)) else failure_text(error, found.__module__)
        raise PluginError(f"plugin '{name}' ({type_name}) cannot be made: {reason}") from error
    if not {"name", "parameters"} <= set(vars(plugin)):
        raise PluginError(
            f"plugin '{name}' ({type_name}) cannot be made: its __init__ does not call "
            "super().__init__(name, parameters)"
        )
    stands_in = found.stands_in
    meant = _full_name(type_name, known)
    if not stands_in and meant != type_name and type_name != plugin_name(meant):
        stands_in = f"{meant} does its job"
    plugin.notes = (*([StandInNote.of(type_name, stands_in)] if stands_in else []), *notes)
    return plugin
