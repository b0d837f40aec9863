"""The make_worlds command: writes a worlds file of generated worlds, or of Gazebo worlds such as BARN's."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, Optional, Sequence

import numpy as np

from mbf_relay.commands import positive, random_seed
from mbf_relay.simulation.difficulty import CELL, difficulty_of
from mbf_relay.simulation.generators import KINDS, generate
from mbf_relay.simulation.sdf import read_sdf
from mbf_relay.simulation.shapes import Box, Cylinder
from mbf_relay.simulation.world import World
from mbf_relay.whole_files import write_whole

BARN_START, BARN_GOAL = (-2.25, 3.0, math.pi / 2), (-2.25, 13.0, math.pi / 2)
"""Start and goal of the BARN challenge in each of its worlds (x, y, yaw)."""
BARN_TIME = 100.0
"""Time limit (s) of the challenge."""
UPRIGHT, ABOVE_GROUND = 0.9999, 0.01
"""Cosine of the largest tilt of a body that counts as upright, and its largest height (m) above the ground."""


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 for an error that a user can fix."""
    options = _parse(sys.argv[1:] if arguments is None else arguments)
    try:
        if options.worlds:
            _check_names(options.worlds)
            entries = [barn_entry(path, options.start, options.goal, _tell) for path in options.worlds]
        else:
            entries = [generate(options.kind, options.seed + number) for number in range(options.count)]
        write_whole(options.out, json.dumps({"worlds": entries}) + "\n")
    except OSError as error:
        print(f"make_worlds.py: {error.filename or options.out}: {error.strerror}", file=sys.stderr)
        return 1
    except ValueError as error:
        print(f"make_worlds.py: {error}", file=sys.stderr)
        return 1
    print(f"{len(entries)} worlds are in {options.out}")
    return 0


def _check_names(paths: Sequence[Path]) -> None:
    """Raise ValueError where two files have the same name, since a worlds file cannot have two worlds of one name."""
    known: Dict[str, Path] = {}
    for path in paths:
        if path.stem in known:
            raise ValueError(f"{known[path.stem]} and {path} would both be the world '{path.stem}'; rename one")
        known[path.stem] = path


def _tell(line: str) -> None:
    print(f"make_worlds.py: {line}", file=sys.stderr)


def barn_entry(
    path: Path, start: Sequence[float] = BARN_START, goal: Sequence[float] = BARN_GOAL,
    tell: Callable[[str], None] = lambda line: None,
) -> Dict[str, Any]:
    """Return an entry of a worlds file for a Gazebo world of upright cylinders and boxes.

    Args:
        path: The world's file, after which the world is named.
        start, goal: x, y, yaw in metres and radians.
        tell: Called with each warning on the file.

    Raises:
        ValueError: It has a body of another shape, or one that is tilted or above the ground, it has no path from start
            to goal, or these are one place; the text says which.
        OSError: It cannot be opened.
    """
    world = read_sdf(str(path))
    for warning in world.warnings:
        tell(f"{path}: {warning}")
    world = replace(world, bodies=tuple(replace(body, mass=0.0) for body in world.bodies))  # no masses in worlds files
    entry: Dict[str, Any] = {
        "name": path.stem, "start": list(start), "goal": list(goal), "goal_radius": 1.0, "time_limit": BARN_TIME,
        "cylinders": [], "boxes": [],
    }
    for body in world.bodies:
        pose, middle = body.frame.flat(), float(body.frame.position[2])
        if isinstance(body.shape, Cylinder):
            height = body.shape.height
            entry["cylinders"].append([pose.x, pose.y, body.shape.radius, middle + height / 2.0])
        elif isinstance(body.shape, Box):
            length, width, height = body.shape.size
            entry["boxes"].append([pose.x, pose.y, pose.theta, length, width, middle + height / 2.0])
        else:
            raise ValueError(f"{path}: '{body.name}' is a {type(body.shape).__name__.lower()}, no cylinder and no box")
        if abs(body.frame.rotation[2, 2]) < UPRIGHT or not 0.0 < middle + height / 2.0 <= height + ABOVE_GROUND:
            raise ValueError(f"{path}: '{body.name}' does not stand upright on the ground, as all in worlds files does")
    if math.dist(start[:2], goal[:2]) < CELL:
        raise ValueError(f"{path}: start and goal, {tuple(start[:2])} and {tuple(goal[:2])}, are one place")
    measured = _measured(world, start, goal)
    if measured is None:
        raise ValueError(f"{path}: no way for the robot leads from {tuple(start[:2])} to {tuple(goal[:2])}")
    entry["reference_path_length"] = round(measured["path_length"], 3)
    entry["difficulty"] = measured
    return entry


def _measured(world: World, start: Sequence[float], goal: Sequence[float]) -> Optional[Dict[str, float]]:
    """Return the measures of a world's difficulty, with its outline drawn into a grid; None where there is no path."""
    segments = world.outline(0.2)
    points = np.concatenate((segments.reshape(-1, 2), [start[:2], goal[:2]]))
    lower = points.min(axis=0) - 1.0
    columns, rows = np.ceil((points.max(axis=0) + 1.0 - lower) / CELL).astype(int)
    walls = np.zeros((rows, columns), bool)
    for one, other in segments:
        shares = np.linspace(0.0, 1.0, 2 + int(4.0 * math.dist(one, other) / CELL))[:, None]
        cells = ((one + shares * (other - one) - lower) / CELL).astype(int)
        walls[cells[:, 1], cells[:, 0]] = True
    found = difficulty_of(walls, tuple(np.array(start[:2]) - lower), tuple(np.array(goal[:2]) - lower))
    return None if found is None else {name: round(value, 3) for name, value in found._asdict().items()}


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make_worlds.py", description="Write a worlds file for batch.py.")
    parser.add_argument(
        "worlds", nargs="*", type=Path, metavar="FILE.world", help="Gazebo worlds to convert, such as BARN's")
    parser.add_argument(
        "--kind", choices=sorted(KINDS), default="barn",
        help="kind of worlds to generate if no file is given (default barn)")
    parser.add_argument(
        "--count", type=positive, default=100, metavar="N", help="number of worlds to generate (default 100)")
    parser.add_argument(
        "--seed", type=random_seed, default=1, metavar="N",
        help="seed of the first world (default 1); equal seeds give equal worlds")
    for name, pose in (("start", BARN_START), ("goal", BARN_GOAL)):
        parser.add_argument(f"--{name}", type=float, nargs=3, default=pose, metavar=("X", "Y", "YAW"),
                            help=f"{name} in converted worlds, in m and rad (default: the BARN challenge's)")
    parser.add_argument(
        "--out", type=Path, default=Path("worlds.json"), metavar="FILE", help="file to write (default worlds.json)")
    return parser.parse_args(arguments)
