"""dynamic_reconfigure for declared parameters: the .cfg files and the run-time server come from one declaration.

The `config/*.cfg` files call `add_parameters` at build time; nodes call `serve` at run time.
"""

from __future__ import annotations

import dataclasses
import importlib
import typing
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Mapping, Optional, Tuple, Type

from mbf_relay.parameters import ParameterSet

if TYPE_CHECKING:
    from mbf_relay.navigation.registry import Registry

try:
    import roslib.launcher
except ImportError:
    pass
else:
    # dynamic_reconfigure's modules call load_manifest(), which under catkin has nothing to do but reads manifests and
    # complains on stderr wherever `rosdep init` was never run. Told that it was called already, it returns at once.
    roslib.launcher._bootstrapped.append("dynamic_reconfigure")

RESTORE_DEFAULTS = "restore_defaults"
"""The switch that upstream's nodes have, too: brings back the values the node was started with."""

Slider = Tuple[Optional[float], Optional[float]]
"""Least and greatest value offered; None for no limit."""


def add_parameters(
    generator: Any, parameter_set: Type[ParameterSet], names: Optional[Iterable[str]] = None, restore: bool = True,
    sliders: Mapping[str, Slider] = MappingProxyType({}),
) -> None:
    """Add a parameter set's numbers, strings and booleans to a dynamic_reconfigure ParameterGenerator.

    Args:
        generator: dynamic_reconfigure.parameter_generator_catkin.ParameterGenerator.
        parameter_set: The dataclass; lists, which dynamic_reconfigure has no type for, are left out.
        names: Only these, where given.
        restore: Add `restore_defaults`, which brings back the values the node was started with.
        sliders: Ranges to offer, by name, where they differ from the declared ones.
    """
    from dynamic_reconfigure.parameter_generator_catkin import bool_t, double_t, int_t, str_t

    types = {bool: bool_t, int: int_t, float: double_t, str: str_t}
    limits = {int: (-(2 ** 31) + 1, 2 ** 31 - 1), float: (None, None)}  # a slider needs both ends
    hints = typing.get_type_hints(parameter_set)
    for field in dataclasses.fields(parameter_set):
        hint = hints[field.name]
        if hint not in types or (names is not None and field.name not in names):
            continue
        meta = field.metadata
        unit = f" ({meta['unit']})" if meta.get("unit") else ""
        arguments = [field.name, types[hint], 0, meta.get("description", "") + unit, field.default]
        if hint in limits:
            lowest = meta["minimum"] if meta["minimum"] is not None else meta["above"]
            ends = sliders.get(field.name, (lowest, meta["maximum"]))
            if meta.get("choices"):
                ends = min(meta["choices"]), max(meta["choices"])
            arguments += [limit if end is None else end for end, limit in zip(ends, limits[hint])]
        if meta.get("choices"):
            constants = [generator.const(_constant(field.name, c), types[hint], c, str(c)) for c in meta["choices"]]
            generator.add(*arguments, edit_method=generator.enum(constants, f"choices of {field.name}"))
        else:
            generator.add(*arguments)
    if restore:
        generator.add(RESTORE_DEFAULTS, bool_t, 0, "Bring back the values the node was started with", False)


def _constant(name: str, choice: Any) -> str:
    text = "".join(letter if letter.isalnum() else "_" for letter in f"{name}_{choice}")
    return text if text[0].isalpha() else f"c_{text}"


def load(path: str) -> Any:
    """Return the module a plugin names as its `dynamic_config`, e.g. mbf_relay.cfg.DwaConfig."""
    return importlib.import_module(path)


def serve_plugin(registry: Registry[Any], name: str) -> None:
    """Serve a plugin's parameters by dynamic_reconfigure, if it has any such.

    Changes apply to the plugin's instances in all slots.
    """
    plugin = registry.plugin(name)
    if plugin.dynamic_config:
        serve(
            load(plugin.dynamic_config), plugin.parameters, lambda parameters: registry.reconfigure(name, parameters),
            namespace=name)


def _check_texts(values: Dict[str, Any]) -> None:
    """Raise ValueError for a string with characters that XML-RPC, and so the parameter server, cannot carry."""
    for name, value in values.items():
        if isinstance(value, str) and not value.replace("\n", " ").replace("\t", " ").isprintable():
            raise ValueError(f"{name} is {value!r}; it must not have characters that cannot be printed")


def _tell_master(values: Mapping[str, Any]) -> None:
    """Set parameters, by their full names, in one XML-RPC call: one by one they were a third of all calls at a start.

    Raises:
        rospy.ROSException: The master refuses one of them.
    """
    import xmlrpc.client  # nosec B411: what the ROS master speaks

    import rosgraph
    import rospy

    calls = xmlrpc.client.MultiCall(xmlrpc.client.ServerProxy(rosgraph.get_master_uri()))
    for name, value in values.items():
        calls.setParam(rospy.get_name(), name, value)
    for code, text, _ in calls():  # type: ignore[attr-defined]
        if code != 1:
            raise rospy.ROSException(f"the master refused a parameter: {text}")


class _Values:
    """The current values of a parameter set, and the callback that changes them; arguments as for `serve`."""

    def __init__(
        self, config_type: Any, parameters: ParameterSet, apply: Callable[[Any], None],
        defaults: Optional[Callable[[], Any]],
    ) -> None:
        self._config_type, self._apply = config_type, apply
        self._current, self._defaults = parameters, defaults or (lambda: parameters)
        self._asked = False

    def take(self, config: Any, _level: int) -> Any:
        """Apply a requested configuration and return the one in force then, as dynamic_reconfigure's callback.

        The server calls it once in its constructor; that call changes nothing and returns the current values.
        """
        import rospy

        names = [name for name in self._current.names() if name in config]
        if self._asked:
            try:
                for note in self._change({name: config[name] for name in names}, config.get(RESTORE_DEFAULTS)):
                    rospy.logwarn("reconfigured: %s", note)
            except ValueError as error:
                rospy.logerr("reconfigure refused: %s", error)
        self._asked = True
        config.update({name: getattr(self._current, name) for name in names})
        if RESTORE_DEFAULTS in config:
            config[RESTORE_DEFAULTS] = False
        return config

    def _change(self, values: Mapping[str, Any], restore: bool) -> List[str]:
        """Apply other values, or the defaults; return notes on values that were changed, as by clamping."""
        notes: List[str] = []
        if restore:
            wanted = self._defaults()
        else:
            # the server clamps all values to their sliders' ranges, also those that no client changes
            changes = {n: value for n, value in values.items() if value != self._within(n, getattr(self._current, n))}
            _check_texts(changes)
            wanted, notes = self._current.reconfigured(changes)
        self._apply(wanted)
        self._current = wanted
        return notes

    def _within(self, name: str, value: Any) -> Any:
        """Return a number clamped to its slider's range, anything else as it is."""
        lowest, highest = self._config_type.min.get(name), self._config_type.max.get(name)
        return value if isinstance(value, (bool, str)) else min(max(value, lowest), highest)


def serve(
    config_type: Any, parameters: ParameterSet, apply: Callable[[Any], None], namespace: str = "",
    defaults: Optional[Callable[[], Any]] = None,
) -> Any:
    """Serve a parameter set by dynamic_reconfigure.

    Args:
        config_type: Generated module, e.g. mbf_relay.cfg.AmclConfig.
        parameters: The current values; they replace the .cfg's defaults as the server's initial state.
        apply: Called with the new set at every change, and not at start; ValueError refuses the change.
        namespace: Below the node's private one, e.g. "DWAPlannerROS"; empty for the node itself.
        defaults: Returns the set that `restore_defaults` brings back, where that is not `parameters`.

    Returns:
        The dynamic_reconfigure server.
    """
    import rospy
    from dynamic_reconfigure.server import Server

    class StartsWithOurs(Server):
        """Starts with the current values, not with the parameter server's, some of which may have been refused."""

        def _copy_from_parameter_server(self) -> None:
            pass

        def _copy_to_parameter_server(self) -> None:
            from dynamic_reconfigure.encoding import extract_params

            _tell_master({
                rospy.resolve_name(self.ns + parameter["name"]): self.config[parameter["name"]]
                for parameter in extract_params(self.type.config_description)
            })

    return StartsWithOurs(config_type, _Values(config_type, parameters, apply, defaults).take, namespace=namespace)
