"""Costmaps made from parameter files, in both of costmap_2d's forms: with a list of plugins, or without as before it."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple

from mbf_relay import plugins
from mbf_relay.costmap import LAYERS
from mbf_relay.costmap.costmap import Costmap, CostmapParameters
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.obstacle_layer import ObstacleLayerParameters, SourceParameters

STATIC_NAMES = ("map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space")
OBSTACLE_NAMES = ("max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space")
VOXEL_NAMES = OBSTACLE_NAMES + (
    "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold", "publish_voxel_map")
INFLATION_NAMES = ("cost_scaling_factor", "inflation_radius")
PARENT_NAMES = {
    "costmap_2d::StaticLayer": STATIC_NAMES,
    "costmap_2d::ObstacleLayer": OBSTACLE_NAMES,
    "costmap_2d::VoxelLayer": VOXEL_NAMES,
    "costmap_2d::InflationLayer": INFLATION_NAMES,
}
"""What costmap_2d takes for a layer from the costmap's own level where the layer's group lacks it."""

OLD_FORM_NAMES = ("static_map", "map_type")
SEARCHED_NAMES = ("footprint", "robot_radius", "footprint_topic", "published_footprint_topic", "obstacle_range", "raytrace_range")
"""What costmap_2d looks for in the namespaces above as well."""


def build_costmap(name: str, values: Mapping[str, Any], above: Optional[Mapping[str, Any]] = None) -> Costmap:
    """Make a costmap from its part of a parameter file.

    Args:
        name: For messages, e.g. "local_costmap".
        values: Names and values as costmap_2d reads them, groups as mappings.
        above: The namespace the costmap's own stands in, where it looks for a footprint and for ranges too.

    Raises:
        ValueError: A value is wrong or a layer unknown; the text names costmap, parameter, value and what is allowed.
    """
    values = {**{key: (above or {})[key] for key in SEARCHED_NAMES if key in (above or {})}, **values}
    try:
        parameters = CostmapParameters.from_mapping(values)
        layers = [_layer(layer_name, type_name, group) for layer_name, type_name, group in layer_groups(values)]
        return Costmap(name, parameters, layers)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def layer_groups(values: Mapping[str, Any]) -> List[Tuple[str, str, Dict[str, Any]]]:
    """Return name, type and parameters of a costmap's layers, whichever form its file has.

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
        if not isinstance(own, Mapping):
            raise ValueError(f"parameter {entry['name']} is {own!r}; it must be the group of that layer's parameters")
        parent = {key: values[key] for key in PARENT_NAMES.get(entry["type"], ()) if key in values}
        result.append((entry["name"], entry["type"], {**parent, **own}))
    return result


def _old_form(values: Mapping[str, Any]) -> List[Tuple[str, str, Dict[str, Any]]]:
    """Return the layers costmap_2d makes where there is no list of them."""
    def group(name: str, names: Tuple[str, ...]) -> Dict[str, Any]:
        own = values.get(name)
        return {**(own if isinstance(own, Mapping) else {}), **{key: values[key] for key in names if key in values}}

    result = []
    if values.get("static_map") is True:
        result.append(("static_layer", "costmap_2d::StaticLayer", group("static_layer", STATIC_NAMES)))
    sources = tuple(str(values.get("observation_sources", "")).split())
    obstacle_type = "costmap_2d::VoxelLayer" if values.get("map_type") == "voxel" else "costmap_2d::ObstacleLayer"
    obstacles = group("obstacle_layer", PARENT_NAMES[obstacle_type] + ("observation_sources",) + sources)
    result.append(("obstacle_layer", obstacle_type, obstacles))
    result.append(("inflation_layer", "costmap_2d::InflationLayer", group("inflation_layer", INFLATION_NAMES)))
    return result


def _layer(name: str, type_name: str, group: Mapping[str, Any]) -> Layer:
    if not isinstance(type_name, str):
        raise ValueError(f"layer '{name}' has type {type_name!r}; it must be a text")
    return plugins.create(name, type_name, group, Layer, LAYERS)


def unknown_names(values: Mapping[str, Any]) -> List[str]:
    """Return the parameters in a costmap's part of a file that nothing reads, as "group/name", for warnings."""
    groups = layer_groups(values)
    old_form = values.get("plugins") is None
    read = set(OLD_FORM_NAMES + SEARCHED_NAMES + ("plugins", "observation_sources"))
    for _, type_name, _ in groups:
        read.update(PARENT_NAMES.get(type_name, ()))
    result = [name for name in CostmapParameters.unknown_names(values) if name not in read]
    sources: Dict[str, Any] = {}
    for layer_name, type_name, group in groups:
        layer_class = plugins.find_class(type_name, Layer, LAYERS)
        prefix = "" if old_form else f"{layer_name}/"
        ranges = ("obstacle_range", "raytrace_range")
        result += [f"{prefix}{name}" for name in layer_class.Parameters.unknown_names(group) if name not in ranges + tuple(read)]
        if issubclass(layer_class.Parameters, ObstacleLayerParameters):
            for source in str(group.get("observation_sources", "")).split():
                sources[f"{prefix}{source}"] = group.get(source, {})
    for prefix, source in sources.items():
        result += [f"{prefix}/{name}" for name in SourceParameters.unknown_names(source)]
    return result
