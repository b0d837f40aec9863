"""Reads robots by name or file: a URDF (see `urdf_robot`), or a YAML file of body, wheels, sensors and limits.

    drive: differential          # or omnidirectional, car
    base_height: 0.01            # m, of base_link above the ground
    body: [{box: [0.14, 0.14, 0.14], at: [-0.03, 0.0, 0.07], mass: 0.8}]     # or cylinder: [radius, height], or
                                                                             # polygon: [[x, y], ...] with height: h
    wheels: {radius: 0.033, width: 0.018, separation: 0.16}
    casters: [{at: [-0.08, 0.0], radius: 0.01}]
    lidar: {at: [-0.03, 0.0, 0.17], yaw: 0.0}
    footprint: [[-0.1, -0.1], [-0.1, 0.1], [0.04, 0.1], [0.04, -0.1]]

Further entries: mass of a part, inertia, outline, imu, and every parameter of the simulator.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from mbf_relay import files
from mbf_relay.geometry import convex_hull
from mbf_relay.misspelling import did_you_mean, nearest_of
from mbf_relay.simulation import robot as robots
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.robot import CAR, DIFFERENTIAL, DRIVES, Caster, Part, RobotModel, Wheels
from mbf_relay.simulation.shapes import Box, Cylinder, Mesh, Shape, prism_triangles
from mbf_relay.simulation.urdf_robot import robot_values

URDF = ".urdf"
OWN_NAMES = (
    "drive", "base_height", "body", "inertia", "outline", "footprint", "wheels", "casters", "lidar", "imu"
)
"""Entries of a robot's file that are not parameters of the simulator."""


def load_robot(text: str) -> RobotModel:
    """Return the robot of a name or file.

    Args:
        text: A file in config/robot without its ending, or the path of a YAML file or a URDF.

    Raises:
        ValueError: There is none, or it is malformed; the text names file and place.
    """
    path, content = _path_of(text), robot_text(text)
    try:
        if path.suffix == URDF:
            return _robot_of_urdf(path.stem, content, str(path.absolute().parent))
        return _robot_of_text(path.stem, content)
    except ValueError as error:
        raise ValueError(f"robot file {path}: {error}") from error


def robot_text(text: str) -> str:
    """Return the content of a robot's file; arguments and errors as for `load_robot`."""
    path = _path_of(text)
    try:
        return files.read_text(str(path))
    except OSError as error:
        raise ValueError(f"robot file {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"robot file {path}: {error}") from error


def _path_of(text: str) -> Path:
    path = Path(text)
    if path.suffix in (".yaml", ".yml", URDF):
        return path
    if path.suffix == ".xacro":
        raise ValueError(f"robot file {path} is to be made a URDF first: xacro {path} > {path.stem.split('.')[0]}.urdf")
    folder = files.config_folder() / "robot"
    path = folder / f"{text}.yaml"
    if not path.is_file():
        known = sorted(file.stem for file in folder.glob("*.yaml"))
        raise ValueError(f"robot '{text}' is not known; there are {', '.join(known)}, or name a .yaml or .urdf file")
    return path


@lru_cache(maxsize=16)
def _robot_of_text(name: str, text: str) -> RobotModel:
    """Return the robot of a YAML file, cached, as parsing is slow and a batch reads one file for each episode."""
    values = files.parse_yaml(text)
    if not isinstance(values, Mapping):
        raise ValueError("it holds no names and values; see config/robot/burger.yaml for those of a robot")
    return robot_of(name, values)


@lru_cache(maxsize=16)
def _robot_of_urdf(name: str, text: str, folder: str) -> RobotModel:
    """Return the robot of a URDF in a folder, cached, as reading meshes is slow."""
    values, names = robot_values(files.parse_xml(text, "it"), folder)
    return replace(robot_of(name, values), **names)


def robot_of(name: str, values: Mapping[str, Any]) -> RobotModel:
    """Return the robot by a file's entries.

    Args:
        name: Name of the robot, for messages.
        values: The entries; see the module's docstring.

    Raises:
        ValueError: An entry is missing or invalid; the text says which.
    """
    drive = values.get("drive", DIFFERENTIAL)
    if drive not in DRIVES:
        raise ValueError(f"drive is {drive!r}; it must be one of {', '.join(DRIVES)}")
    wheels = Wheels.from_mapping(_group(values, "wheels"))
    _refuse_unknown("wheels", _group(values, "wheels"), Wheels.names())
    if drive != DIFFERENTIAL and wheels.base <= 0.0:
        raise ValueError(f"wheels: base is {wheels.base}; a drive of four wheels needs it above 0 m")
    if drive == CAR and wheels.turning_radius <= 0.0:
        raise ValueError("wheels: turning_radius is 0; it must be above 0 m for a car")
    parts = tuple(_part(entry) for entry in _listed(values, "body"))
    if not parts:
        raise ValueError("body lists no box, cylinder or polygon")
    made: Dict[str, Any] = dict(
        name=name, drive=drive, base_height=_numbers(values, "base_height", 0, wheels.radius), body=parts,
        inertia=tuple(_numbers(values, "inertia", 3, robots.box_inertia(parts))), wheels=wheels,
        casters=tuple(_caster(entry) for entry in _listed(values, "casters")), outline=np.empty((0, 2)),
        footprint=np.empty((0, 2)), scan_in_base=_place(values, "lidar"), imu_in_base=_place(values, "imu"),
        settings={key: value for key, value in values.items() if key not in OWN_NAMES},
    )
    places = RobotModel(**made).wheel_places()
    made["outline"] = _polygon(values, "outline", robots.seen_from_above(parts, wheels, places))
    made["footprint"] = _polygon(values, "footprint", made["outline"])
    return RobotModel(**made)


def _part(entry: Mapping[str, Any]) -> Part:
    _refuse_unknown("body", entry, ("box", "cylinder", "polygon", "height", "at", "yaw", "mass"))
    shape: Shape
    if "box" in entry:
        shape = Box(tuple(_numbers(entry, "box", 3)))
    elif "cylinder" in entry:
        radius, height = _numbers(entry, "cylinder", 2)
        shape = Cylinder(radius, height)
    elif "polygon" in entry:
        half = _numbers(entry, "height", 0) / 2.0
        shape = Mesh(prism_triangles(convex_hull(_polygon(entry, "polygon", np.empty(0))), -half, half))
    else:
        raise ValueError(f"body has an entry {dict(entry)!r}; it must be a box, a cylinder or a polygon with a height")
    return Part(shape, _place({"part": entry}, "part"), _numbers(entry, "mass", 0))


def _caster(entry: Mapping[str, Any]) -> Caster:
    _refuse_unknown("casters", entry, ("at", "radius", "mass"))
    x, y = _numbers(entry, "at", 2)
    return Caster(x, y, _numbers(entry, "radius", 0), _numbers(entry, "mass", 0, 0.01))


def _place(values: Mapping[str, Any], name: str) -> Frame:
    group = _group(values, name)
    x, y, z = _numbers(group, "at", 3, (0.0, 0.0, 0.0))
    return Frame.of(x, y, z, yaw=_numbers(group, "yaw", 0, 0.0))


def _group(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    group = values.get(name, {})
    if not isinstance(group, Mapping):
        raise ValueError(f"{name} is {group!r}; it must be a group of names and values")
    return group


def _listed(values: Mapping[str, Any], name: str) -> List[Mapping[str, Any]]:
    entries = values.get(name, [])
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        raise ValueError(f"{name} is {entries!r}; it must be a list of groups of names and values")
    return entries


def _polygon(values: Mapping[str, Any], name: str, default: np.ndarray) -> np.ndarray:
    if name not in values:
        return default
    points = values[name]
    if not isinstance(points, list) or len(points) < 3 or not all(isinstance(p, list) and len(p) == 2 for p in points):
        raise ValueError(f"{name} is {points!r}; it must be a list of three corners [x, y] or more")
    return np.array([_numbers({name: point}, name, 2) for point in points], dtype=float)


def _numbers(values: Mapping[str, Any], name: str, count: int, default: Any = None) -> Any:
    """Return `count` finite numbers, a single one for 0."""
    value: Any = values.get(name, default)
    entries: Sequence[Any] = [value] if count == 0 else value if isinstance(value, (list, tuple)) else []
    good = [entry for entry in entries if isinstance(entry, (int, float)) and not isinstance(entry, bool)]
    if len(good) != max(1, count) or len(entries) != len(good) or not np.isfinite(good).all():
        wanted = "a number" if count == 0 else f"a list of {count} numbers"
        raise ValueError(f"{name} is {value!r}; it must be {wanted}")
    made: Tuple[float, ...] = tuple(float(entry) for entry in good)
    return made[0] if count == 0 else made


def _refuse_unknown(where: str, values: Mapping[str, Any], known: Sequence[str]) -> None:
    for name in values:
        if name not in known:
            raise ValueError(f"{where}: there is no '{name}'{did_you_mean(nearest_of(str(name), known))}")
