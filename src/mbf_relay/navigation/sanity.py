"""Doubtful parameters: values within their ranges that are hardly meant, such as a speed in cm/s."""

from __future__ import annotations

import contextlib
import math
from typing import Any, Iterator, List, Mapping, Tuple, Type

import numpy as np

from mbf_relay.control.critics import CRITICS
from mbf_relay.costmap.factory import layer_class, layer_groups
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.costmap.obstacle_layer import ObstacleLayerParameters
from mbf_relay.costmap.outline import parse_footprint, radii
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.costmap.range_layer import RangeSensorLayerParameters
from mbf_relay.costmap.static_layer import StaticLayerParameters
from mbf_relay.misspelling import nearest_of
from mbf_relay.parameters import ParameterSet
from mbf_relay.plugins import PluginError, find_class

FASTEST = {"max_vel_x": 5.0, "max_vel_y": 5.0, "max_vel_trans": 5.0, "max_trans_vel": 5.0, "max_vel_lin": 5.0}
"""Top speeds (m/s) above which a value is probably in cm/s: indoor robots are slower."""
FASTEST_TURN = {"max_vel_theta": 7.0, "max_rot_vel": 7.0, "max_rotational_vel": 7.0, "max_vel_th": 7.0}
"""Turn rates (rad/s) above which a value is probably in degrees per second."""
WIDEST_TOLERANCE = {"xy_goal_tolerance": (2.0, "m"), "yaw_goal_tolerance": (math.tau, "rad")}
"""Goal tolerances above which most goals count as reached at once, with their units."""

SAME_SIZE = 0.1
"""Largest relative difference of the two costmaps' inscribed radii, as by a padding of one of them."""

OUTLINES = ("footprint", "robot_radius")
"""Parameters of the robot's outline; the first one that is given is used."""

NEVER_MOVES = {
    "max_vel_trans": "drive", "max_trans_vel": "drive", "max_vel_x": "drive forward", "max_vel_theta": "turn",
    "max_rot_vel": "turn", "max_rotational_vel": "turn", "max_vel_th": "turn",
}
"""Top speeds, and what the robot never does where one is 0."""

IDLE = "so that the layer marks nothing"
"""Consequence, in doubts, of a layer without sensors where others have some; the next two: where none has, or where a
costmap's whole group is missing."""
BLIND = "so that nothing is seen there: the robot drives into what is not on the map"
MAPLESS = "so that paths are planned without the map, and with the defaults of costmap_2d in all else"

Doubt = Tuple[str, str]
"""Name of the parameter relative to the node, and the text."""


def doubts(config: Mapping[str, Any]) -> List[Doubt]:
    """Return the doubtful values among a server's parameters."""
    found: List[Doubt] = []
    for side, follows in (("global_costmap", MAPLESS), ("local_costmap", BLIND)):
        if side not in config:
            found.append((side, f"is not given, {follows}"))
    for name, group in config.items():
        if isinstance(group, Mapping):
            if name in ("global_costmap", "local_costmap"):
                found += [(f"{name}/{key}", text) for key, text in _of_costmap(group, config)]
                if name == "local_costmap":
                    found += [(f"{name}/{key}", text) for key, text in _of_what_is_driven_by(group)]
            else:
                found += [(f"{name}/{key}", text) for key, text in _of_controller(group)]
    return found + _of_two_outlines(config)


def _of_two_outlines(config: Mapping[str, Any]) -> List[Doubt]:
    """Return a doubt where the two costmaps have robots of different sizes."""
    inscribed = []
    for side in ("global_costmap", "local_costmap"):
        group = config.get(side)
        group = group if isinstance(group, Mapping) else {}
        try:
            values = {name: group.get(name, config.get(name)) for name in OUTLINES}
            costmap = CostmapParameters.from_mapping({name: v for name, v in values.items() if v is not None})
            inscribed.append(radii(costmap.outline())[0])
        except ValueError:
            return []  # told elsewhere
    planned, driven = inscribed
    if abs(planned - driven) <= SAME_SIZE * max(inscribed):
        return []
    return [(_outline_of_what_drives(config), (
        f"reaches {driven:.2f} m from the robot's middle to its nearest edge, the global costmap's {planned:.2f} m: "
        "paths are planned for another robot than drives them; give both the same footprint or robot_radius"))]


def _outline_of_what_drives(config: Mapping[str, Any]) -> str:
    """Return the name of the parameter that sets the local costmap's outline.

    As in costmap_2d, a footprint in the parent namespace comes before a robot_radius in the costmap's own, unless it is
    empty.
    """
    local = config.get("local_costmap")
    groups = {"local_costmap/": local if isinstance(local, Mapping) else {}, "": config}
    footprint = next((group["footprint"] for group in groups.values() if "footprint" in group), ())
    names = OUTLINES if len(parse_footprint(footprint)) else OUTLINES[1:]
    given = [f"{prefix}{name}" for name in names for prefix, group in groups.items() if name in group]
    return (given or ["local_costmap/footprint"])[0]


def _of_costmap(group: Mapping[str, Any], config: Mapping[str, Any]) -> Iterator[Doubt]:
    text = group.get("footprint", config.get("footprint"))
    try:
        corners = parse_footprint(text) if text is not None else np.zeros((0, 2))
    except ValueError:
        return  # told elsewhere, with all else that is no footprint
    if len(corners) and radii(corners)[1] > 10.0:
        yield "footprint", f"is {text!r}: it reaches {radii(corners)[1]:.1f} m; lengths are in metres"
    radius = group.get("robot_radius", config.get("robot_radius"))
    if _number(radius) > 10.0:
        yield "robot_radius", f"is {radius}; lengths are in metres"
    if not len(corners) and _is_zero(radius):
        yield "robot_radius", f"is {radius}, and there is no footprint: what takes no room fits through every gap"
    yield from _of_inflation(group, radii(corners)[0] if len(corners) else _number(radius))
    yield from _of_order(group)
    yield from _of_sources(group)


def _of_what_is_driven_by(group: Mapping[str, Any]) -> Iterator[Doubt]:
    """Yield doubts about a local costmap without sensors, layers of it without any, or without updates."""
    seeing = [(name, kind.groups(values)) for name, kind, values in _layers(group)
              if issubclass(kind, ObstacleLayerParameters)]
    eyes = _seeing_layers(group)
    if not eyes:
        yield "plugins", (f"lists no layer that takes what a sensor sees, {BLIND}; the list replaces all other layers, "
                          "and the costmap's own observation_sources are not read beside it")
    elif all(values.get("enabled") is False for values in eyes.values()):
        yield f"{next(iter(eyes))}/enabled", f"is False, {BLIND}"
    effect = IDLE if any(sources for _name, sources in seeing) else BLIND
    for name, sources in seeing:
        if not sources:
            at = f"{name}/observation_sources" if "plugins" in group else "observation_sources"
            yield at, f"is not given, {effect}{_why_not_given(name, group)}"
    if _is_zero(group.get("update_frequency")):
        yield "update_frequency", (
            f"is {group['update_frequency']}; nothing is driven by a costmap that is never updated")


def _why_not_given(layer: str, group: Mapping[str, Any]) -> str:
    """Return why a layer may have no observation_sources although they were meant; empty where nothing tells."""
    named = {name for name, _type, _values in layer_groups(group)}
    strays = [name for name, values in group.items() if isinstance(values, Mapping) and name not in named]
    nearly, text = nearest_of(layer, strays), ""
    if nearly is not None:
        text += f"; there is a group '{nearly}', and no layer of that name"
    if "observation_sources" in group:
        text += "; the costmap's own are not read for layers it lists"
    return text


def _of_sources(group: Mapping[str, Any]) -> Iterator[Doubt]:
    """Yield doubts about sources without a group of parameters: they become point clouds on a topic of their name."""
    for name, kind, values in _layers(group):
        if not issubclass(kind, ObstacleLayerParameters):
            continue
        for source in kind.groups(values):
            if source in values:
                continue
            at = f"{name}/{source}" if "plugins" in group else source
            data_type = kind.source_defaults.get("data_type", SourceParameters.data_type)
            text = f"is not given, so that source '{source}' is a {data_type} on topic '{source}'"
            if source in group:
                text += "; the costmap's own group of that name is not read for layers it lists"
            yield at, text


def _seeing_layers(group: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
    """Return the parameters of the layers that may show what a sensor sees, enabled or not, by the layers' names.

    One of ours that has sensors, one that has overridden `sources`, one that is not found, or one that takes a map by
    another topic than the usual one: octomap_server's and rtabmap's are made of what is seen.
    """
    try:
        listed = [(name, layer_class(type_name, values), values) for name, type_name, values in layer_groups(group)]
    except ValueError:
        return {"": {}}  # told elsewhere
    usual = StaticLayerParameters.map_topic
    return {name: values for name, kind, values in listed
            if kind.sources is not Layer.sources or values.get("map_topic", usual) not in (usual, f"/{usual}")}


def _layers(group: Mapping[str, Any]) -> Iterator[Tuple[str, Type[ParameterSet], Any]]:
    """Yield name, parameter set and values of each enabled layer; invalid ones are reported elsewhere."""
    with contextlib.suppress(ValueError):
        for name, type_name, values in layer_groups(group):
            with contextlib.suppress(ValueError):
                if values.get("enabled") is not False:
                    yield name, layer_class(type_name, values).Parameters, values


def _of_inflation(group: Mapping[str, Any], inscribed: float) -> Iterator[Doubt]:
    """Yield doubts about an inflation radius below the robot's inscribed radius (m), of which Nav2 warns too."""
    for name, kind, values in _layers(group):
        inflation = _number(values.get("inflation_radius"), otherwise=math.inf)
        if "inflation_radius" in kind.names() and inflation < inscribed:
            written = group.get(name)
            at = f"{name}/inflation_radius" if isinstance(written, Mapping) and "inflation_radius" in written else (
                "inflation_radius")
            yield at, (f"is {inflation:g} m, less than the {inscribed:.2f} m from the robot's middle to its nearest "
                       "edge: paths lead closer to obstacles than it can drive")


def _of_order(group: Mapping[str, Any]) -> Iterator[Doubt]:
    """Yield a doubt about obstacle layers listed after the inflation layer, which then does not inflate them."""
    late: List[str] = []
    inflation = ""
    for name, kind, values in _layers(group):
        if "inflation_radius" in kind.names():
            late, inflation = [], name
        elif inflation and (issubclass(kind, RangeSensorLayerParameters) or _marks(kind, values)):
            late.append(name)
    if late:
        yield "plugins", (f"lists {', '.join(map(repr, late))} after '{inflation}', which inflates only what layers "
                          "before it have marked: paths lead right beside what is seen; list it last")


def _marks(kind: Type[ParameterSet], values: Mapping[str, Any]) -> bool:
    """Return whether it is an obstacle layer with a source that marks; others only clear."""
    sources = kind.groups(values) if issubclass(kind, ObstacleLayerParameters) else []
    return any(not isinstance(values.get(source), Mapping) or values[source].get("marking") is not False
               for source in sources)


def _of_controller(group: Mapping[str, Any]) -> Iterator[Doubt]:
    for name, most in FASTEST.items():
        if math.inf > _number(group.get(name)) > most:  # endless speeds are refused
            yield name, f"is {group[name]}; speeds are in m/s, and hardly any robot drives faster than {most:g} m/s"
    for name, most in FASTEST_TURN.items():
        if math.inf > _number(group.get(name)) > most:
            yield name, f"is {group[name]}; turn rates are in rad/s, and {most:g} is more than a turn a second"
    for name, never in NEVER_MOVES.items():
        if _is_zero(group.get(name)):
            yield name, f"is {group[name]}; the robot would never {never}"
    if not _rules_out_contacts(group.get("critics")):
        yield "critics", ("lists no 'obstacle', which rules out what touches: the robot drives into what it sees; the "
                          "list replaces the default one")
    for name, (most, unit) in WIDEST_TOLERANCE.items():
        if _number(group.get(name)) > most:
            yield name, f"is {group[name]}; beyond {most:.3g} {unit} most goals count as reached at once"


def _rules_out_contacts(critics: Any) -> bool:
    """Return whether one of DWA's critics rules out trajectories in collision; True for lists that are not DWA's."""
    from mbf_relay.control.critics.critic import Critic  # here, as composed nodes without critics import this module

    try:
        kinds = [find_class(name, Critic, CRITICS) for name in critics or ()]
    except (PluginError, TypeError, AttributeError):
        return True  # of another controller, or told elsewhere
    return not kinds or any(kind.rules_out_contacts for kind in kinds)


def _is_zero(value: Any) -> bool:
    return _number(value, otherwise=math.nan) == 0.0


def _number(value: Any, otherwise: float = 0.0) -> float:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else otherwise
