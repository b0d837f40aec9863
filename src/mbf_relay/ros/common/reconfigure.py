"""dynamic_reconfigure over declared parameters: one declaration makes the .cfg and takes the changes.

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

Slider = Tuple[Optional[float], Optional[float]]
"""The least and the greatest value offered."""


def add_parameters(
    generator: Any, parameter_set: Type[ParameterSet], names: Optional[Iterable[str]] = None, restore: bool = True,
    sliders: Mapping[str, Slider] = MappingProxyType({}),
) -> None:
    """Add a parameter set's numbers, texts and switches to a dynamic_reconfigure ParameterGenerator.

    Args:
        generator: dynamic_reconfigure.parameter_generator_catkin.ParameterGenerator.
        parameter_set: The dataclass; lists, which dynamic_reconfigure has no type for, are left out.
        names: Only these, where given.
        restore: Add `restore_defaults`, which brings back the values the node was started with.
        sliders: Range to offer by name, where it is not what a file may say; None for an end that has none.
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


def serve_plugin(registry: Registry[Any], name: str) -> List[Any]:
    """Offer a plugin's parameters for change at run time where it has any such, in every slot; keep the result."""
    plugin = registry.plugin(name)
    if not plugin.dynamic_config:
        return []

    def apply(parameters: Any) -> None:
        registry.reconfigure(name, parameters)

    return [serve(load(plugin.dynamic_config), plugin.parameters, apply, namespace=name)]


def _check_texts(values: Dict[str, Any]) -> None:
    """Raise ValueError where a text is none that the parameter server can keep, which speaks XML."""
    for name, value in values.items():
        if isinstance(value, str) and not value.replace("\n", " ").replace("\t", " ").isprintable():
            raise ValueError(f"{name} is {value!r}; it must not have characters that cannot be printed")


def _tell_master(values: Mapping[str, Any]) -> None:
    """Set parameters, by their full names, in one call: one by one they were a third of all calls of a start.

    Raises:
        rospy.ROSException: The master takes one of them not.
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
    """A set's values in force, and how a change to them is taken; arguments as for `serve`."""

    def __init__(
        self, config_type: Any, parameters: ParameterSet, apply: Callable[[Any], None],
        defaults: Optional[Callable[[], Any]],
    ) -> None:
        self._config_type, self._apply = config_type, apply
        self._current, self._defaults = parameters, defaults or (lambda: parameters)
        self._asked = False

    def take(self, config: Any, _level: int) -> Any:
        """Take what dynamic_reconfigure's server is asked for, and return what holds then.

        Its first question, as it is made, is what to begin with: the values in force.
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
        """Put other values, or the defaults, in force; return notes on what was made of them."""
        notes: List[str] = []
        if restore:
            wanted = self._defaults()
        else:
            # the server takes all values into their sliders' ranges, also those nobody asked to change
            changes = {n: value for n, value in values.items() if value != self._within(n, getattr(self._current, n))}
            _check_texts(changes)
            wanted, notes = self._current.reconfigured(changes)
        self._apply(wanted)
        self._current = wanted
        return notes

    def _within(self, name: str, value: Any) -> Any:
        """Return a number taken to the range that is offered, anything else as it is."""
        lowest, highest = self._config_type.min.get(name), self._config_type.max.get(name)
        return value if isinstance(value, (bool, str)) else min(max(value, lowest), highest)


def serve(
    config_type: Any, parameters: ParameterSet, apply: Callable[[Any], None], namespace: str = "",
    defaults: Optional[Callable[[], Any]] = None,
) -> Any:
    """Offer a parameter set's values for change at run time.

    Args:
        config_type: Generated module, e.g. mbf_relay.cfg.AmclConfig.
        parameters: The values in force; they become the server's first state, over the .cfg's defaults.
        apply: Called with the new set after every change; not called at start.
        namespace: Below the node's own, e.g. "DWAPlannerROS"; empty for the node itself.
        defaults: Gives the set that `restore_defaults` brings back, where that is not `parameters`.

    Returns:
        The dynamic_reconfigure server; keep it.
    """
    import rospy
    from dynamic_reconfigure.server import Server

    class StartsWithOurs(Server):
        """Starts with the values in force, not with what stands on the parameter server, of which some was refused."""

        def _copy_from_parameter_server(self) -> None:
            pass

        def _copy_to_parameter_server(self) -> None:
            from dynamic_reconfigure.encoding import extract_params

            _tell_master({
                rospy.resolve_name(self.ns + parameter["name"]): self.config[parameter["name"]]
                for parameter in extract_params(self.type.config_description)
            })

    return StartsWithOurs(config_type, _Values(config_type, parameters, apply, defaults).take, namespace=namespace)
