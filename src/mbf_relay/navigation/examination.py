"""Check of a parameter file without running it: what is used, clamped, replaced by a stand-in, ignored or refused."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Type

from mbf_relay.costmap.factory import SEARCHED_NAMES, build_costmap, unknown_names
from mbf_relay.misspelling import did_you_mean, nearest_of
from mbf_relay.navigation.move_base_files import driven_by, recovery_notes, server_config
from mbf_relay.navigation.move_base_parameters import OTHER_MOVE_BASE_NAMES, MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.plugin_lists import PLUGIN_LISTS, PluginList
from mbf_relay.navigation.registry import entries_of, values_of
from mbf_relay.navigation.sanity import doubts
from mbf_relay.parameters import ParameterSet
from mbf_relay.plugins import PluginError, StandInNote, create, find_class

USED, STOOD_IN, CLAMPED, IGNORED, DOUBTFUL, REFUSED = KINDS = (
    "used", "stood in for", "changed", "ignored", "doubtful", "refused"
)
"""Kinds of findings about a parameter or a plugin. REFUSED ones keep the server, or a part of it, from starting."""

PARAMETER = re.compile(r"\bparameter ([A-Za-z_]\w*)")
"""Finds the name of the parameter in a message."""
QUOTED = re.compile(r"'([^']+)'")
"""Finds names of layers and sources in a message."""
NOTHING: Dict[str, Any] = {}
"""Default of an optional group; never changed."""
SHORTEST_NAME = 4
"""Shortest group name (characters) that is looked for as a part of plugins' names."""

SIDES = ("global_costmap", "local_costmap")
READ_BY_THE_NODE = (
    *(plugins.kind for plugins in PLUGIN_LISTS), "planner_lock_costmap", "controller_lock_costmap", "restore_defaults",
    *SEARCHED_NAMES,
)
"""Parameters in the server's namespace that are read elsewhere than by NavigatorParameters."""


class Finding(NamedTuple):
    """One finding.

    Attributes:
        kind: One of KINDS.
        name: The parameter or plugin, relative to the node, parts joined by slashes; empty for the node itself.
        text: Explanation for the user.
    """

    kind: str
    name: str
    text: str


@dataclass
class Examination:
    """The findings, and the node's parameters made from the file.

    Attributes:
        findings: In the order they were found.
        config: The parameters; for a node move_base, those of the server that stands in for it.
    """

    findings: List[Finding] = field(default_factory=list)
    config: Dict[str, Any] = field(default_factory=dict)

    def of(self, *kinds: str) -> List[Finding]:
        """Return the findings of these kinds."""
        return [finding for finding in self.findings if finding.kind in kinds]

    def add(self, kind: str, name: str, text: str) -> None:
        """Note a finding."""
        self.findings.append(Finding(kind, name, text))


def examine_move_base(namespace: Mapping[str, Any], known_elsewhere: Iterable[str] = ()) -> Examination:
    """Examine the parameters of a node move_base.

    Args:
        namespace: The parameters in its private namespace.
        known_elsewhere: Names in it that other code reads.
    """
    found = Examination()
    elsewhere = {*OTHER_MOVE_BASE_NAMES, *NavigatorParameters.names(), *READ_BY_THE_NODE, *known_elsewhere}
    values = _read(found, "", MoveBaseParameters, namespace, elsewhere)
    if values is not None:
        try:
            found.config = server_config(namespace, driven_by(values, namespace))
        except ValueError as error:
            found.add(REFUSED, _named_in(str(error), "local_costmap"), str(error))
            return found
        for note in recovery_notes(namespace):
            found.add(CLAMPED, "recovery_behaviors", note)
        _examine(found)
    return found


def examine_server(namespace: Mapping[str, Any]) -> Examination:
    """Examine the parameters of a Move Base Flex server."""
    found = Examination(config=dict(namespace))
    for name in NavigatorParameters.unknown_names(namespace):
        if name not in READ_BY_THE_NODE and not isinstance(namespace[name], Mapping):  # see stray_groups
            _note_unknown(found, name, NavigatorParameters)
    _examine(found)
    return found


def examine_set(
    kind: Type[ParameterSet], namespace: Mapping[str, Any], known_elsewhere: Iterable[str] = ()
) -> Examination:
    """Examine the parameters of a node that has a single parameter set.

    Args:
        kind: The parameter set's class.
        namespace: The parameters in the node's private namespace.
        known_elsewhere: Names that the node reads besides.
    """
    found = Examination(config=dict(namespace))
    known = {name for name in namespace if name not in kind.unknown_names(namespace)}
    for name in namespace:
        if name not in known and name not in known_elsewhere:
            _note_unknown(found, name, kind)
    for old, new in kind.deprecated_names(namespace).items():
        found.add(CLAMPED, old, f"has an old name; '{new}' is the present one")
    made = _read(found, "", kind, namespace, None)
    if made is not None:
        for name in namespace:
            if (name in known or name in known_elsewhere) and name not in made.set_in_vain():
                found.add(USED, name, f"{namespace[name]}")
    return found


def _examine(found: Examination) -> None:
    """Examine a server's own parameters, costmaps, plugins, stray groups, and values that can hardly be meant."""
    _read(found, "", NavigatorParameters, found.config, None)
    for side in SIDES:
        _examine_costmap(found, side)
    names: List[str] = []
    for plugins in PLUGIN_LISTS:
        names += _examine_plugins(found, plugins)
    for name, hint in stray_groups(found.config, names).items():
        found.add(IGNORED, name, f"belongs to no plugin that is loaded{hint}")
    for name, text in doubts(found.config):
        found.add(DOUBTFUL, name, text)
    refused = {finding.name for finding in found.of(REFUSED)}
    found.findings = [f for f in found.findings if f.kind != IGNORED or f.name not in refused]


def _examine_costmap(found: Examination, side: str) -> None:
    group = found.config.get(side, {})
    try:
        for name, hint in unknown_names(group).items() if isinstance(group, Mapping) else ():
            found.add(IGNORED, f"{side}/{name}", f"is not known here{hint}")
        costmap = build_costmap(side, group, found.config)
    except ValueError as error:
        found.add(REFUSED, _named_in(str(error), side), str(error))
        return
    for note in costmap.notes:
        found.add(_kind_of(note), _named_in(note, side, group), f"{side}: {note}")
    for name, reason in costmap.failed.items():
        found.add(REFUSED, f"{side}/{name}", f"the layer is left out: {reason}")
    for layer in costmap.layers:
        found.add(USED, f"{side}/{layer.name}", f"{type(layer).__name__}")
        _note_in_vain(found, f"{side}/{layer.name}/", layer.parameters)
        for name, source in layer.sources.items():
            _note_in_vain(found, f"{side}/{layer.name}/{name}/", source)


def _examine_plugins(found: Examination, listed: PluginList[Any]) -> List[str]:
    """Make every plugin of a list once, note what becomes of its parameters, and return the plugins' names."""
    try:
        entries = entries_of(listed.kind, found.config.get(listed.kind, []), listed.costmap)
    except PluginError as error:
        found.add(REFUSED, listed.kind, str(error))
        return []
    for name, (type_name, _costmap) in entries.items():
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                values = values_of(found.config, name, find_class(type_name, listed.base, listed.known))
                plugin = create(name, type_name, values, listed.base, listed.known)
        except PluginError as error:
            found.add(REFUSED, _named_in(str(error), name), str(error))
            continue
        found.add(USED, name, f"{type_name} by {type(plugin).__name__}")
        for warning in said:
            found.add(CLAMPED, name, str(warning.message))
        for note in plugin.notes:
            found.add(_kind_of(note), _named_in(note, name), note)
        for unknown in plugin.Parameters.unknown_names(values):
            _note_unknown(found, f"{name}/{unknown}", plugin.Parameters)
        _note_in_vain(found, f"{name}/", plugin.parameters)
        for old, new in plugin.Parameters.deprecated_names(values).items():
            found.add(CLAMPED, f"{name}/{old}", f"has an old name; '{new}' is the present one")
    return list(entries)


def stray_groups(config: Mapping[str, Any], plugins: Iterable[str]) -> Dict[str, str]:
    """Return the groups whose name no plugin has, each with a hint: under a misspelt name all values are ignored.

    Args:
        config: The node's parameters.
        plugins: Names of all plugins of the lists, also of those that could not be made.
    """
    known = [*plugins, *SIDES]
    first_parts = [name.split("/")[0] for name in known]
    return {
        name: "" if names_a_plugin(name) else did_you_mean(nearest_of(name, known)) for name, values in config.items()
        if isinstance(values, Mapping) and name not in [*known, *first_parts]
    }


def names_a_plugin(group: str) -> bool:
    """Return whether a group's name is that of a plugin of this package, or a part of one, such as PurePursuit.

    Such groups need no warning: files often have parameters for more controllers than the one in use.
    """
    others = (name.rpartition("/")[2] for listed in PLUGIN_LISTS for name in listed.known)
    return len(group) >= SHORTEST_NAME and any(group in other for other in others)


def _read(
    found: Examination, where: str, kind: Type[Any], values: Mapping[str, Any], elsewhere: Any
) -> Any:
    """Return a parameter set made from a group's values, None where they are refused.

    Args:
        found: Takes the findings.
        where: The group's name, empty for the node's own parameters.
        kind: The parameter set's class.
        values: The group.
        elsewhere: Names that other code reads; None to report no unknown names.
    """
    prefix = f"{where}/" if where else ""
    if elsewhere is not None:
        for name in kind.unknown_names(values):
            if name not in elsewhere and not isinstance(values[name], Mapping):  # see stray_groups
                _note_unknown(found, prefix + name, kind)
    try:
        made, notes = kind.read(values)
    except ValueError as error:
        found.add(REFUSED, _named_in(str(error), where), str(error))
        return None
    for note in notes:
        found.add(CLAMPED, _named_in(note, where), note)
    _note_in_vain(found, prefix, made)
    return made


def _note_in_vain(found: Examination, prefix: str, parameters: ParameterSet) -> None:
    for name, description in parameters.set_in_vain().items():
        found.add(IGNORED, prefix + name, f"is {description}")


def _kind_of(note: str) -> str:
    return STOOD_IN if isinstance(note, StandInNote) else CLAMPED


def _named_in(note: str, where: str, group: Mapping[str, Any] = NOTHING) -> str:
    """Return the full name of the parameter that a note is about.

    Args:
        note: The message.
        where: Name of the group that is examined.
        group: Its values; the parameter may be in the subgroup of a layer or a source that the note names.
    """
    named = PARAMETER.search(note)
    if named is None:
        return where
    path = _path_to(named.group(1), group, QUOTED.findall(note)) or named.group(1)
    return f"{where}/{path}" if where else path


def _path_to(name: str, group: Mapping[str, Any], through: Sequence[str]) -> str:
    """Return a parameter's name relative to `group`, with the subgroups of the names `through` searched; else empty."""
    if name in group:
        return name
    for part in through:
        below = group.get(part)
        path = _path_to(name, below, through) if isinstance(below, Mapping) else ""
        if path:
            return f"{part}/{path}"
    return ""


def _note_unknown(found: Examination, name: str, kind: Type[ParameterSet]) -> None:
    if name.rpartition("/")[2] == "restore_defaults":  # set by dynamic_reconfigure itself, for rqt's button
        return
    found.add(IGNORED, name, "is not known here" + kind.hint(name.rpartition("/")[2]))
