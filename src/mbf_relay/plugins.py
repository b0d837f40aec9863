"""Plugins: what they share, and how a type name in a parameter file becomes an object."""

from __future__ import annotations

import importlib
import inspect
from typing import Any, ClassVar, Mapping, Type, TypeVar

from mbf_relay.parameters import ParameterSet


class Plugin:
    """Something a user can replace: planner, controller, critic, layer or recovery behaviour.

    A plugin is a class with `Parameters`, a frozen dataclass derived from ParameterSet, in a module on PYTHONPATH; its
    type in the parameter file is `package.module.Class`.

    Attributes:
        name: The name the user gave it; its parameters stand under that name.
        parameters: The values in force; they change only by `reconfigure`.
    """

    Parameters: ClassVar[Type[ParameterSet]] = ParameterSet

    def __init__(self, name: str, parameters: Any) -> None:
        self.name = name
        self.parameters = parameters

    def reconfigure(self, parameters: Any) -> None:
        """Take new parameters at run time; override to recompute what depends on them."""
        self.parameters = parameters


P = TypeVar("P", bound=Plugin)


class PluginError(ValueError):
    """A plugin could not be found or made; the text names it and what is available."""


def find_class(type_name: str, base: Type[P], known: Mapping[str, str]) -> Type[P]:
    """Return the class a type name stands for.

    Args:
        type_name: A key of `known` (the names upstream uses, e.g. "navfn/NavfnROS") or "package.module.Class".
        base: The abstract class it must derive from.
        known: Upstream and short names to "package.module.Class".

    Raises:
        PluginError: Nothing of that name, not of that kind, or a method of that kind is missing.
    """
    path = known.get(type_name, type_name)
    module_name, _, class_name = path.rpartition(".")
    available = ", ".join(sorted(known))
    if not module_name:
        raise PluginError(
            f"unknown {base.__name__.lower()} type '{type_name}'; available: {available}, "
            "or package.module.Class of your own"
        )
    try:
        found = getattr(importlib.import_module(module_name), class_name)
    except (ImportError, AttributeError, SyntaxError) as error:
        raise PluginError(
            f"{base.__name__.lower()} type '{type_name}' cannot be loaded ({error}); available: {available}"
        ) from error
    if not (isinstance(found, type) and issubclass(found, base)):
        raise PluginError(f"'{type_name}' is no {base.__name__.lower()}: it must derive from {base.__module__}.{base.__name__}")
    if inspect.isabstract(found):
        missing = ", ".join(sorted(found.__abstractmethods__))
        raise PluginError(f"{base.__name__.lower()} type '{type_name}' does not define {missing}")
    return found


def create(name: str, type_name: str, values: Mapping[str, Any], base: Type[P], known: Mapping[str, str]) -> P:
    """Make a plugin from its name, its type and its parameters.

    Raises:
        PluginError: The type is unknown, a parameter is wrong, or the constructor raised a ValueError or OSError; the text
            names plugin and parameter.
    """
    found = find_class(type_name, base, known)
    try:
        parameters = found.Parameters.from_mapping(values)
    except ValueError as error:
        raise PluginError(f"plugin '{name}' ({type_name}): {error}") from error
    try:
        return found(name, parameters)
    except (ValueError, OSError) as error:
        raise PluginError(f"plugin '{name}' ({type_name}) cannot be made: {error}") from error
