"""Declared parameters (mbf_relay.parameters) filled from the parameter server."""

from __future__ import annotations

from typing import Any, Iterable, List, Mapping, Type, TypeVar

import rospy

from mbf_relay.parameters import ParameterSet
from mbf_relay.ros.common.reconfigure import RESTORE_DEFAULTS
from mbf_relay.ros.common.tf_prefix import ignored_prefix

T = TypeVar("T", bound=ParameterSet)

OWN_FILE = 3
"""Number of a node's parameters found in the namespace above it, from which on its file counts as loaded there."""


def load(parameter_set: Type[T], namespace: str = "~", known_elsewhere: Iterable[str] = ()) -> T:
    """Read a parameter set from a namespace of the parameter server.

    Args:
        parameter_set: The dataclass to fill.
        namespace: Namespace of its names; "~" for the node's private one.
        known_elsewhere: Names of that namespace that others read, of which there is no warning.

    Raises:
        ValueError: A value is of the wrong type or out of range; the text names parameter, value and what is allowed.
    """
    if namespace == "~":
        warn_of_own_file_beside(parameter_set.names())
    return fill(parameter_set, read_namespace(namespace), namespace, known_elsewhere)


def fill(parameter_set: Type[T], values: Mapping[str, Any], where: str, known_elsewhere: Iterable[str] = ()) -> T:
    """Fill a parameter set from `values`, warning once about each name that is unknown, old or not as allowed.

    Args:
        parameter_set: The dataclass to fill.
        values: Names and values.
        where: Namespace, for warnings and errors.
        known_elsewhere: Names that others read, of which there is no warning.

    Raises:
        ValueError: As for `load`.
    """
    warn_of_unknown(parameter_set, values, where, known_elsewhere)
    try:
        result, notes = parameter_set.read(values)
    except ValueError as error:
        raise ValueError(f"{error} (in {rospy.resolve_name(where)})") from error
    warn_of(notes, where)
    return result


def warn_of(notes: Iterable[str], where: str) -> None:
    """Log notes of a parameter set on values that were changed, such as clamped ones, as warnings."""
    for note in notes:
        rospy.logwarn("%s: %s", rospy.resolve_name(where), note)


def warn_of_unknown(
    parameter_set: Type[ParameterSet], values: Mapping[str, Any], where: str, known_elsewhere: Iterable[str] = ()
) -> None:
    """Warn about each name in `values` that is unknown or out of date, groups too; arguments as for `fill`."""
    for name in parameter_set.unknown_names(values):
        # dynamic_reconfigure writes this switch to the parameter server, where the next start of the node finds it.
        if name not in known_elsewhere and name != RESTORE_DEFAULTS:
            rospy.logwarn("parameter %s is not known here and is ignored%s", rospy.resolve_name(join(where, name)),
                          parameter_set.hint(name))
    for old, new in parameter_set.deprecated_names(values).items():
        rospy.logwarn("parameter %s has an old name; use '%s'", rospy.resolve_name(join(where, old)), new)


def warn_of_own_file_beside(names: Iterable[str]) -> None:
    """Warn where a node's file seems to be loaded into the namespace above the node, in which it reads nothing.

    Args:
        names: Names of all parameters and groups of the node.
    """
    above = rospy.get_namespace()
    standing = {name[len(above):].partition("/")[0] for name in rospy.get_param_names() if name.startswith(above)}
    beside = sorted(standing.intersection(names))
    if len(beside) >= OWN_FILE:
        node = rospy.get_name().rpartition("/")[2]
        rospy.logwarn(
            "parameters %s, ... stand beside %s, which does not read them there: in a file of overrides, "
            "put a node's parameters below a line with its name, '%s:'",
            ", ".join(above + name for name in beside[:OWN_FILE]), rospy.get_name(), node)


def warn_of_tf_prefix(base_frame: str) -> None:
    """Warn where a tf_prefix is set for this node with which the robot's base frame does not begin."""
    found = rospy.search_param("tf_prefix")
    text = ignored_prefix(found, rospy.get_param(found, ""), base_frame) if found else ""
    if text:
        rospy.logwarn("%s", text)


def groups_in(values: Mapping[str, Any]) -> List[str]:
    """Return the names of the groups in `values`, for `known_elsewhere` where unknown groups are reported elsewhere."""
    return [name for name, value in values.items() if isinstance(value, Mapping)]


def read_namespace(namespace: str) -> Mapping[str, Any]:
    """Return all parameters of a namespace as a dictionary, empty where it has none.

    Raises:
        ValueError: There is a single value by that name.
    """
    values = rospy.get_param(namespace if namespace != "~" else rospy.get_name(), {})
    if not isinstance(values, Mapping):
        raise ValueError(f"parameter {rospy.resolve_name(namespace)} is {values!r}; it must be a group of parameters")
    return values


def join(namespace: str, name: str) -> str:
    """Return the name of a parameter inside a namespace."""
    return f"{namespace}{name}" if namespace in ("", "~") or namespace.endswith("/") else f"{namespace}/{name}"
