"""Translation of a parameter file written for move_base to the parameters of a Move Base Flex server."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Tuple

from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.registry import entries_of
from mbf_relay.parameters import convert
from mbf_relay.plugins import PluginError, plugin_name

CONSERVATIVE, ROTATE, AGGRESSIVE = "conservative_reset", "rotate_recovery", "aggressive_reset"
"""Names of move_base's default recovery behaviours."""
CLEAR_TYPE, ROTATE_TYPE = "clear_costmap_recovery/ClearCostmapRecovery", "rotate_recovery/RotateRecovery"
"""Their types."""

USUAL_RADIUS = 0.46
"""Circumscribed radius (m) that move_base assumes where the file gives none. Its aggressive reset clears the costmaps
outside of a square round the robot whose side is four such radii."""

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

PATIENCE_AT_FIRST = 15.0
"""move_base's controller_patience (s) where no file sets it: its code starts with 15 s, and the default 5 s of its
dynamic_reconfigure server, though shown, is applied only once somebody changes a parameter."""

PLUGIN_PARAMETERS: Mapping[str, str] = {"planners": "base_global_planner", "controllers": "base_local_planner"}
"""The server's lists of plugins, and the parameter by which move_base names the one of each that it uses."""


def driven_by(values: Any, namespace: Mapping[str, Any]) -> Any:
    """Return the parameters in force in a move_base that has just started; see PATIENCE_AT_FIRST.

    Args:
        values: MoveBaseParameters read from the namespace.
        namespace: The node's parameters.
    """
    return values if "controller_patience" in namespace else values.replace(controller_patience=PATIENCE_AT_FIRST)


def adapted(type_name: str, namespace: Mapping[str, Any]) -> str:
    """Return the type of the plugin that a nav_core_adapter plugin wraps; any other type unchanged.

    Args:
        type_name: Type given in the file.
        namespace: The node's parameters; `planner_name` in the adapter's group is the wrapped type.
    """
    if not type_name.replace("::", "/").startswith("nav_core_adapter/"):
        return type_name
    inner = _group(namespace, plugin_name(type_name)).get("planner_name")
    return inner.replace("::", "/") if isinstance(inner, str) else type_name


def default_recoveries(values: Any) -> Tuple[str, ...]:
    """Return move_base's default recovery behaviours in order: each of the two resets, followed by a rotation.

    Args:
        values: MoveBaseParameters.
    """
    turn = (ROTATE,) if values.clearing_rotation_allowed else ()
    return (CONSERVATIVE, *turn, AGGRESSIVE, *turn)


def lists_recoveries(namespace: Mapping[str, Any]) -> bool:
    """Return whether a file has a valid list of recoveries; with one entry wrong move_base uses its default ones."""
    return "recovery_behaviors" in namespace and not recovery_notes(namespace)


def recovery_notes(namespace: Mapping[str, Any]) -> List[str]:
    """Return why the default recoveries are used instead of those in the file; empty where the file's list is used."""
    try:
        entries_of("recovery_behaviors", namespace.get("recovery_behaviors", []), "global")
    except PluginError as error:
        return [f"{error}; the default recovery behaviors are used, as move_base does"]
    return []


def server_values(values: Any) -> Dict[str, Any]:
    """Return the server's parameters for a move_base's MoveBaseParameters, by the server's names.

    A patience of 0 means a single try in move_base, but no limit in Move Base Flex; it becomes max_retries = 0 here.
    """
    result = {server_name: getattr(values, name) for name, server_name in SERVER_NAMES.items()}
    for kind in ("planner", "controller"):
        patience = f"{kind}_patience"
        if result[patience] == 0.0:
            result.update({patience: getattr(NavigatorParameters(), patience), f"{kind}_max_retries": 0})
    return result


def server_config(namespace: Mapping[str, Any], values: Any) -> Dict[str, Any]:
    """Return the server's parameters for those in the private namespace of a node move_base.

    Args:
        namespace: The node's parameters, with the groups of plugins and costmaps.
        values: MoveBaseParameters read from it.

    Raises:
        ValueError: The local costmap's circumscribed_radius is no number.
    """
    config = {"recovery_patience": 0.0, **namespace}  # move_base has no such timeout
    config.update(server_values(values))
    for kind, parameter in PLUGIN_PARAMETERS.items():
        given = getattr(values, parameter)
        type_name = adapted(given, namespace)
        if type_name != given:
            config.pop(plugin_name(given))  # the adapter's group has only `planner_name`, which was read
        config[kind] = [{"name": plugin_name(type_name), "type": type_name}]
    costmap = _group(namespace, "global_costmap")
    config["global_frame"] = str(costmap.get("global_frame", "map"))
    config["robot_frame"] = str(costmap.get("robot_base_frame", "base_link"))
    if not lists_recoveries(namespace):
        config["recovery_behaviors"] = _listed(default_recoveries(values))
        radius = _group(namespace, "local_costmap").get("circumscribed_radius", USUAL_RADIUS)
        reach = 4.0 * convert("circumscribed_radius", radius, float)
        for name, distance in ((CONSERVATIVE, values.conservative_reset_dist), (AGGRESSIVE, reach)):
            config[name] = {"reset_distance": distance, **_group(namespace, name)}
    own = set(values.names()) - set(SERVER_NAMES.values())
    return {name: value for name, value in config.items() if name not in own}


def _listed(names: Tuple[str, ...]) -> List[Dict[str, str]]:
    return [
        {"name": name, "type": ROTATE_TYPE if name == ROTATE else CLEAR_TYPE} for name in dict.fromkeys(names)
    ]


def _group(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    group = values.get(name, {})
    return group if isinstance(group, Mapping) else {}
