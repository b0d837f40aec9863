"""Reads worlds files: JSON files with many worlds of cylinders, boxes and movers, with start and goal."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from mbf_relay import files
from mbf_relay.geometry import Pose2D, degrees_told
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Shape
from mbf_relay.simulation.world import Mover, World

KNOWN = {
    "name", "cylinders", "boxes", "movers", "start", "goal", "goal_radius", "reference_path_length", "time_limit",
    "about", "difficulty", "map",
}
"""Entries of a world."""
KNOWN_OF_MOVERS = {"name", "radius", "height", "box", "waypoints", "loop"}
"""Entries of a mover."""
ORANGE = (0.85, 0.45, 0.20, 1.0)
"""Colour (RGBA) of movers."""


def load_worlds_file(path: Path) -> List[World]:
    """Return the worlds of a file.

    The file holds `worlds`, a list of {name, cylinders: [[x, y, radius, height], ...], boxes: [[x, y, yaw, length,
    width, height], ...], start: [x, y, yaw], goal: [x, y, yaw], goal_radius, reference_path_length, time_limit,
    movers, map}; all but name and start are optional, and goal_radius is 1 m by default. `movers` is a list of {name,
    radius and height or box: [length, width, height], waypoints: [[time, x, y], ...] or [[time, x, y, yaw], ...],
    loop}; `map` is the YAML file of a map, relative to the worlds file. Metres, radians, seconds.

    Raises:
        ValueError: The file is missing or malformed; the text names file, world and entry.
    """
    worlds = [world_of(path, index, entry) for index, entry in enumerate(_entries(path))]
    names = [world.name for world in worlds]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"worlds file {path} has two worlds named '{twice[0]}'; names must differ")
    return worlds


def _entries(path: Path) -> List[Any]:
    try:
        content = json.loads(files.read_text(str(path)))
    except OSError as error:
        raise ValueError(f"worlds file {path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        hint = "; make_worlds.py makes worlds files of Gazebo's worlds" if path.suffix in (".world", ".sdf") else ""
        raise ValueError(f"worlds file {path} is no JSON: {error}{hint}") from error
    entries = content.get("worlds") if isinstance(content, Mapping) else None
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"worlds file {path} holds no list 'worlds'")
    return entries


def load_difficulties(path: Path) -> Dict[str, Dict[str, float]]:
    """Return the measures in each world's `difficulty`, by world and name; errors as for `load_worlds_file`."""
    stated = {entry.get("name"): entry.get("difficulty") for entry in _entries(path) if isinstance(entry, Mapping)}
    return {
        name: {key: float(value) for key, value in values.items() if _is_number(value)}
        for name, values in stated.items() if isinstance(name, str) and isinstance(values, Mapping)
    }


def read_worlds_file(path: str, world_name: str = "") -> World:
    """Return one world of a file, the first where no name is given; errors as for `load_worlds_file`."""
    worlds = {world.name: world for world in load_worlds_file(Path(path))}
    if world_name and world_name not in worlds:
        raise ValueError(f"worlds file {path} has no world '{world_name}'; it has {', '.join(worlds)}")
    return worlds[world_name] if world_name else next(iter(worlds.values()))


def world_of(path: Path, index: int, entry: Any) -> World:
    """Return the world of an entry of a file.

    Args:
        path: The file.
        index: Index of the entry in it.
        entry: The entry; see `load_worlds_file`.

    Raises:
        ValueError: It is malformed; the text names file, world and entry.
    """
    if not isinstance(entry, Mapping):
        raise ValueError(f"worlds file {path}: world {index} is {type(entry).__name__}, not an object")
    name = entry.get("name")
    where = f"worlds file {path}: world {name if isinstance(name, str) else index}"
    try:
        if not isinstance(name, str) or not name:
            raise ValueError("has no name")
        bodies = [_pillar(f"{name}_{i}", values) for i, values in enumerate(_list(entry, "cylinders"))]
        bodies += [_box(f"{name}_box_{i}", values) for i, values in enumerate(_list(entry, "boxes"))]
        world = World(
            name,
            tuple(bodies),
            _pose(entry, "start"),
            tuple(_mover(i, mover) for i, mover in enumerate(_list(entry, "movers"))),
            _pose(entry, "goal") if "goal" in entry else None,
            _positive(entry, "goal_radius") or 1.0,
            _positive(entry, "reference_path_length"),
            _positive(entry, "time_limit"),
            map_file=_map_file(path, entry.get("map")),
        )
        return replace(world, warnings=(*_not_understood(name, entry), *_hardly_meant(world, _list(entry, "boxes"))))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{where}: {error}") from error


def _not_understood(name: str, entry: Mapping[str, Any]) -> Iterator[str]:
    """Yield a warning for each unknown key of an entry or of its movers."""
    yield from (f"'{key}' of world {name} is not understood" for key in entry if key not in KNOWN)
    for index, mover in enumerate(entry.get("movers", [])):
        unknown = (key for key in mover if key not in KNOWN_OF_MOVERS)
        yield from (f"'{key}' of mover {index} of world {name} is not understood" for key in unknown)


def _hardly_meant(world: World, boxes: Sequence[Sequence[float]]) -> Iterator[str]:
    """Yield a warning for each implausible value: yaws in degrees, a reference path shorter than the straight line."""
    yaws = {"the start": [world.start.theta], "the goal": [world.goal.theta] if world.goal is not None else [],
            "a box": [box[2] for box in boxes]}
    for what, values in yaws.items():
        told = degrees_told(max(values, key=abs, default=0.0))
        if told:
            yield f"the yaw of {what} of world {world.name} {told}"
    least = world.start.distance_to(world.goal) - world.goal_radius if world.goal is not None else 0.0
    if world.reference_path_length is not None and world.reference_path_length < least:
        yield (f"reference_path_length of world {world.name} is {world.reference_path_length:g} m; straight from start "
               f"to within goal_radius of the goal it is {least:g} m, so that score and SPL are too low")


def _map_file(path: Path, name: Any) -> Optional[str]:
    if name is not None and not isinstance(name, str):
        raise ValueError(f"map is {name!r}; it must be the name of a map's YAML file")
    return None if name is None else str(path.resolve().parent / name)


def _pillar(name: str, values: Any) -> Body:
    x, y, radius, height = _numbers("a cylinder", values, 4)
    return Body(name, Cylinder(radius, height), Frame.of(x, y, height / 2.0))


def _box(name: str, values: Any) -> Body:
    x, y, yaw, length, width, height = _numbers("a box", values, 6)
    return Body(name, Box((length, width, height)), Frame.of(x, y, height / 2.0, yaw=yaw))


def _mover(index: int, entry: Any) -> Mover:
    if not isinstance(entry, Mapping):
        raise ValueError(f"mover {index} is {entry!r}; it must be an object")
    shape: Shape
    if "box" in entry:
        length, width, height = _numbers(f"the box of mover {index}", entry["box"], 3)
        shape = Box((length, width, height))
    else:
        radius, tall = _positive(entry, "radius"), _positive(entry, "height")
        if radius is None or tall is None:
            raise ValueError(f"mover {index} needs a radius and a height, or a box")
        shape, height = Cylinder(radius, tall), tall
    waypoints = _list(entry, "waypoints")
    count = 4 if waypoints and isinstance(waypoints[0], list) and len(waypoints[0]) == 4 else 3
    rows = np.zeros((len(waypoints), 4))
    rows[:, :count] = [_numbers(f"a waypoint of mover {index}", row, count) for row in waypoints] or np.empty(
        (0, count)
    )
    name, loop = str(entry.get("name", f"mover_{index}")), entry.get("loop", True)
    if not isinstance(loop, bool):
        raise ValueError(f"loop of mover {index} is {loop!r}; it must be true or false")
    body = Body(name, shape, Frame.of(0.0, 0.0, height / 2.0), colour=ORANGE)
    return Mover(body, rows[:, 0], rows[:, 1:], loop)


def _pose(entry: Mapping[str, Any], name: str) -> Pose2D:
    return Pose2D(*_numbers(name, entry.get(name), 3))


def _list(entry: Mapping[str, Any], name: str) -> List[Any]:
    values = entry.get(name, [])
    if not isinstance(values, list):
        raise ValueError(f"{name} is {values!r}; it must be a list")
    return values


def _numbers(what: str, values: Any, count: int) -> Tuple[float, ...]:
    if not isinstance(values, list) or len(values) != count or not all(_is_number(value) for value in values):
        raise ValueError(f"{what} is {values!r}; it must be {count} finite numbers")
    return tuple(float(value) for value in values)


def _positive(entry: Mapping[str, Any], name: str) -> Optional[float]:
    value = entry.get(name)
    if value is not None and not (_is_number(value) and value > 0.0):
        raise ValueError(f"{name} is {value!r}; it must be a number above 0")
    return None if value is None else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
