"""Costmaps from parameter files, in both of costmap_2d's forms: with a list `plugins`, or in the older form without it.
"""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple, Type

from mbf_relay import plugins
from mbf_relay.costmap import LAYERS
from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.costmap.obstacle_layer import ObstacleLayerParameters
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.costmap.track_layer import TrackLayerParameters
from mbf_relay.misspelling import did_you_mean, nearest_of
from mbf_relay.parameters import ParameterSet

STATIC_NAMES = ("map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space")
RANGE_NAMES = ("raytrace_range", "obstacle_range", "track_unknown_space")
OBSTACLE_NAMES = ("max_obstacle_height",) + RANGE_NAMES
VOXEL_NAMES = RANGE_NAMES + (
    "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold", "publish_voxel_map")
SPATIO_TEMPORAL_NAMES = ("obstacle_range", "track_unknown_space")
INFLATION_NAMES = ("cost_scaling_factor", "inflation_radius")
SPATIO_TEMPORAL = "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer"
PARENT_NAMES = {
    SPATIO_TEMPORAL: SPATIO_TEMPORAL_NAMES,
    "costmap_2d::StaticLayer": STATIC_NAMES,
    "costmap_2d::ObstacleLayer": OBSTACLE_NAMES,
    "costmap_2d::VoxelLayer": VOXEL_NAMES,
    "costmap_2d::InflationLayer": INFLATION_NAMES,
}
"""Parameters that costmap_2d copies from the costmap's own level into a layer's group, by the layer's type."""
WHERE_LACKING = {"costmap_2d::VoxelLayer": RANGE_NAMES, SPATIO_TEMPORAL: SPATIO_TEMPORAL_NAMES}
"""Those of them that are copied only where the group lacks them; otherwise the costmap's value replaces the group's."""

COSTMAPS = ("global_costmap", "local_costmap")
"""Names of a server's costmaps."""

OLD_FORM_NAMES = ("static_map", "map_type")
SEARCHED_NAMES = (
    "footprint", "robot_radius", "footprint_topic", "published_footprint_topic", "obstacle_range", "raytrace_range",
    "obstacle_overlap",
)
"""Parameters also read from the namespace above: by costmap_2d (searchParam), or since both costmaps should agree."""


def build_costmap(name: str, values: Mapping[str, Any], above: Optional[Mapping[str, Any]] = None) -> Costmap:
    """Make a costmap from its part of a parameter file.

    A layer of an unknown C++ type is left out and named in the costmap's `failed`; the other layers work without it. A
    layer of a Python class (a type with a dot) that cannot be loaded is an error.

    Args:
        name: Its name in log lines and errors, e.g. "local_costmap".
        values: Names and values as costmap_2d reads them, groups as mappings.
        above: Parameters of the namespace above the costmap's own, where SEARCHED_NAMES are looked for too.

    Raises:
        ValueError: A value is wrong, or a layer in Python cannot be loaded; the text names costmap, parameter, value
            and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"{name}: is {values!r}; it must be a group of parameters")
    values = {**{key: (above or {})[key] for key in SEARCHED_NAMES if key in (above or {})}, **values}
    try:
        parameters, notes = CostmapParameters.read(values)
        layers: List[Layer] = []
        failed: Dict[str, str] = {}
        for layer_name, type_name, group in layer_groups(values):
            try:
                layers.append(_layer(layer_name, type_name, group))
            except _UnknownLayer as error:
                failed[layer_name] = str(error)
        notes += _groups_in_vain(values) + _overruled(values)
        notes += [type(note)(f"layer '{layer.name}': {note}") for layer in layers for note in layer.notes]
        return Costmap(name, parameters, layers, notes, failed)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _groups_in_vain(values: Mapping[str, Any]) -> List[str]:
    """Return a note on each parameter with the name of a layer that is no group, such as `static_map: true`."""
    return [
        f"parameter {name} is {values[name]!r} and no group; layer '{name}' takes its defaults, as costmap_2d's does"
        for name, _type_name, _group in (layer_groups(values) if values.get("plugins") is not None else [])
        if not isinstance(values.get(name, {}), Mapping)
    ]


def _overruled(values: Mapping[str, Any]) -> List[str]:
    """Return a note on each value in a layer's group that the costmap's own level replaces."""
    return [
        f"layer '{layer}': parameter {name} is {values[layer][name]!r}, and {used[name]!r} at the costmap's level; the "
        "latter is used, as by costmap_2d"
        for layer, _type_name, used in layer_groups(values) if isinstance(values.get(layer), Mapping)
        for name in values[layer] if values[layer][name] != used[name]
    ]


class _UnknownLayer(ValueError):
    """A layer of an unknown C++ type, for which no other type can stand in."""


def layer_groups(values: Mapping[str, Any]) -> List[Tuple[str, str, Dict[str, Any]]]:
    """Return name, type and parameters of a costmap's layers, in either form of the file.

    Raises:
        ValueError: `plugins` is no list of {name, type}.
    """
    listed = values.get("plugins")
    if listed is None:
        return _old_form(values)
    result = []
    for entry in listed if isinstance(listed, (list, tuple)) else [listed]:
        if not (isinstance(entry, Mapping) and {"name", "type"} <= set(entry)):
            raise ValueError(f"parameter plugins holds {entry!r}; each entry must be {{name: NAME, type: TYPE}}")
        own = values.get(entry["name"], {})
        own = own if isinstance(own, Mapping) else {}  # static_map: true in Fetch's files; costmap_2d ignores it too
        parent = {key: values[key] for key in PARENT_NAMES.get(entry["type"], ()) if key in values}
        lacking = {key: own[key] for key in WHERE_LACKING.get(entry["type"], ()) if key in own}
        result.append((entry["name"], entry["type"], {**own, **parent, **lacking}))
    return result


def _old_form(values: Mapping[str, Any]) -> List[Tuple[str, str, Dict[str, Any]]]:
    """Return the layers costmap_2d makes where there is no list `plugins`."""
    def group(name: str, names: Tuple[str, ...]) -> Dict[str, Any]:
        own = values.get(name)
        return {**(own if isinstance(own, Mapping) else {}), **{key: values[key] for key in names if key in values}}

    result = []
    if values.get("static_map") is True:
        result.append(("static_layer", "costmap_2d::StaticLayer", group("static_layer", STATIC_NAMES)))
    sources = tuple(str(values.get("observation_sources", "")).split())
    obstacle_type = "costmap_2d::VoxelLayer" if values.get("map_type") == "voxel" else "costmap_2d::ObstacleLayer"
    obstacles = group(
        "obstacle_layer", OBSTACLE_NAMES + PARENT_NAMES[obstacle_type] + ("observation_sources",) + sources)
    result.append(("obstacle_layer", obstacle_type, obstacles))
    if isinstance(values.get("track_layer"), Mapping):  # costmap_2d has no such layer: only where the group is given
        result.append(
            (
                "track_layer",
                "mbf_relay::TrackLayer",
                group("track_layer", OBSTACLE_NAMES + ("observation_sources",) + sources),
            )
        )
    result.append(("inflation_layer", "costmap_2d::InflationLayer", group("inflation_layer", INFLATION_NAMES)))
    return result


def _layer(name: str, type_name: str, group: Mapping[str, Any]) -> Layer:
    try:
        found = _class_of(type_name, group)
    except plugins.PluginError as error:
        raise ValueError(f"layer '{name}': {error}") from error
    layer = plugins.create(name, found, group, Layer, LAYERS)
    if found != type_name:
        note = plugins.StandInNote.of(type_name, f"{found} marks what its observation_sources see")
        layer.notes = (note, *layer.notes)
    return layer


def layer_class(type_name: str, group: Mapping[str, Any]) -> Type[Layer]:
    """Return the class of a layer, given its type and parameters.

    Raises:
        ValueError: There is no class for that type.
    """
    return plugins.find_class(_class_of(type_name, group), Layer, LAYERS)


def _class_of(type_name: str, group: Mapping[str, Any]) -> str:
    """Return the layer type to use for `type_name`.

    For an unknown C++ type with `observation_sources` that is the obstacle or voxel layer; else the type itself.

    Raises:
        PluginError: It is no text, or a Python class that cannot be loaded.
        _UnknownLayer: It is an unknown C++ type without `observation_sources`.
    """
    if not isinstance(type_name, str):
        raise plugins.PluginError(f"its type is {type_name!r}; it must be a text")
    try:
        plugins.find_class(type_name, Layer, LAYERS)
    except plugins.PluginError as error:
        if "." in type_name:
            raise
        if not group.get("observation_sources"):
            raise _UnknownLayer(str(error)) from error
        return "costmap_2d::VoxelLayer" if "z_voxels" in group else "costmap_2d::ObstacleLayer"
    return type_name


def _may_be_the_other_s(value: Any) -> bool:
    """Return whether a value is a layer's or source's group, perhaps of the other costmap: files are often shared."""
    if not isinstance(value, Mapping):
        return False
    kinds: List[Type[ParameterSet]] = [SourceParameters]
    kinds += [plugins.find_class(name, Layer, LAYERS).Parameters for name in LAYERS]
    return not value or any(set(kind.names()) & set(value) for kind in kinds)


def unknown_names(values: Mapping[str, Any]) -> Dict[str, str]:
    """Return the parameters of a costmap that nothing reads, as "name" or "group/name", each with a hint."""
    groups = layer_groups(values)
    old_form = values.get("plugins") is None
    read = set(OLD_FORM_NAMES + SEARCHED_NAMES + ("plugins", "observation_sources"))
    read.update(OBSTACLE_NAMES if old_form else ())
    for _, type_name, _ in groups:
        read.update(PARENT_NAMES.get(type_name, ()))
    below: Dict[str, str] = {}
    sources: Dict[str, Tuple[Any, Type[SourceParameters]]] = {}
    for layer_name, type_name, group in groups:
        try:
            kind = layer_class(type_name, group).Parameters
        except ValueError:
            continue  # a layer of an unknown type
        prefix = "" if old_form else f"{layer_name}/"
        for name in kind.unknown_names(group):
            if name not in read:
                below[f"{prefix}{name}"] = kind.hint(name)
        if issubclass(kind, (ObstacleLayerParameters, TrackLayerParameters)):
            for source in kind.groups(group):
                sources[f"{prefix}{source}"] = group.get(source, {}), getattr(kind, "source_kind", SourceParameters)
    for prefix, (group, source_kind) in sources.items():
        for name in source_kind.unknown_names(group):
            below[f"{prefix}/{name}"] = source_kind.hint(name)
    read.update(sources, (name for name, _, _ in groups))
    here = [*CostmapParameters.names(), *sorted(read)]
    own = {
        name: _loaded_twice(name) or _reader_of(name) or did_you_mean(nearest_of(name, here))
        for name in CostmapParameters.unknown_names(values)
        if name not in read and (name in COSTMAPS or not _may_be_the_other_s(values[name]))
    }
    return {**own, **below}


def _loaded_twice(name: str) -> str:
    """Return the hint on a costmap's group within a costmap's group, empty for other names."""
    return f"; a file that begins with '{name}:' is loaded without ns" if name in COSTMAPS else ""


def _reader_of(name: str) -> str:
    """Return the hint on a parameter that only a layer type not in use reads, empty for others."""
    kind = next((kind for kind, names in PARENT_NAMES.items() if name in names), None)
    return f"; {kind} reads it, which is not among the layers" if kind else ""
