"""Worlds files: many worlds of cylinders in one JSON file, with where to start, where to go, and what moves there."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Cylinder
from mbf_relay.simulation.world import Mover, World


def load_worlds_file(path: Path) -> List[World]:
    """Return the worlds of a file.

    The file holds `worlds`, a list of {name, cylinders: [[x, y, radius, height], ...], start: [x, y, yaw],
    goal: [x, y, yaw], goal_radius, reference_path_length, time_limit, movers}; all but name, cylinders and start may be
    left out. `movers` is a list of {radius, height, waypoints: [[time, x, y], ...], loop}. Metres, radians, seconds.

    Raises:
        ValueError: The file is missing or malformed; the text names file, world and entry.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"worlds file {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"worlds file {path} is no JSON: {error}") from error
    entries = content.get("worlds") if isinstance(content, Mapping) else None
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"worlds file {path} holds no list 'worlds'")
    worlds = [_world(path, index, entry) for index, entry in enumerate(entries)]
    names = [world.name for world in worlds]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"worlds file {path} has two worlds named '{twice[0]}'; names must differ")
    return worlds


def _world(path: Path, index: int, entry: Any) -> World:
    if not isinstance(entry, Mapping):
        raise ValueError(f"worlds file {path}: world {index} is {type(entry).__name__}, not an object")
    name = entry.get("name")
    where = f"worlds file {path}: world {name if isinstance(name, str) else index}"
    try:
        if not isinstance(name, str) or not name:
            raise ValueError("has no name")
        return World(
            name,
            tuple(_pillar(f"{name}_{i}", cylinder) for i, cylinder in enumerate(_list(entry, "cylinders"))),
            _pose(entry, "start"),
            tuple(_mover(i, mover) for i, mover in enumerate(entry.get("movers", []))),
            _pose(entry, "goal") if "goal" in entry else None,
            _positive(entry, "goal_radius", 1.0), _positive(entry, "reference_path_length"), _positive(entry, "time_limit"),
        )
    except (ValueError, TypeError) as error:
        raise ValueError(f"{where}: {error}") from error


def _pillar(name: str, values: Any) -> Body:
    x, y, radius, height = _numbers("a cylinder", values, 4)
    return Body(name, Cylinder(radius, height), Frame.of(x, y, height / 2.0))


def _mover(index: int, entry: Mapping[str, Any]) -> Mover:
    radius, height = _positive(entry, "radius"), _positive(entry, "height")
    if radius is None or height is None:
        raise ValueError(f"mover {index} needs a radius and a height")
    rows = np.array([_numbers(f"a waypoint of mover {index}", row, 3) for row in _list(entry, "waypoints")])
    body = Body(f"mover_{index}", Cylinder(radius, height), Frame.of(0.0, 0.0, height / 2.0))
    poses = np.column_stack((rows[:, 1:], np.zeros(len(rows)))) if len(rows) else np.empty((0, 3))
    return Mover(body, rows[:, 0] if len(rows) else np.empty(0), poses, bool(entry.get("loop", True)))


def _pose(entry: Mapping[str, Any], name: str) -> Pose2D:
    return Pose2D(*_numbers(name, entry.get(name), 3))


def _list(entry: Mapping[str, Any], name: str) -> List[Any]:
    values = entry.get(name)
    if not isinstance(values, list):
        raise ValueError(f"{name} is {values!r}; it must be a list")
    return values


def _numbers(what: str, values: Any, count: int) -> Tuple[float, ...]:
    if not isinstance(values, list) or len(values) != count or not all(_is_number(value) for value in values):
        raise ValueError(f"{what} is {values!r}; it must be {count} finite numbers")
    return tuple(float(value) for value in values)


def _positive(entry: Mapping[str, Any], name: str, default: Optional[float] = None) -> Optional[float]:
    value = entry.get(name, default)
    if value is not None and not (_is_number(value) and value > 0.0):
        raise ValueError(f"{name} is {value!r}; it must be a number above 0")
    return None if value is None else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
