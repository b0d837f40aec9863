"""Loads worlds by name or file."""

from __future__ import annotations

import os
from typing import Callable, Dict, List

from mbf_relay.simulation.arena import arena
from mbf_relay.simulation.floor import leveled
from mbf_relay.simulation.map_world import read_map_world
from mbf_relay.simulation.sdf import read_sdf
from mbf_relay.simulation.urdf import read_urdf
from mbf_relay.simulation.world import World
from mbf_relay.simulation.worlds_file import read_worlds_file


def empty() -> World:
    """Return a world with nothing but the ground."""
    return World("empty", ())


BUILT_IN: Dict[str, Callable[[], World]] = {"arena": arena, "empty": empty, "turtlebot3_world": arena}

READERS: Dict[str, Callable[[str, str], World]] = {
    ".yaml": lambda path, name: read_map_world(path),
    ".yml": lambda path, name: read_map_world(path),
    ".json": read_worlds_file,
    ".sdf": lambda path, name: read_sdf(path),
    ".world": lambda path, name: read_sdf(path),
    ".urdf": lambda path, name: read_urdf(path),
}


def load_world(text: str, world_name: str = "") -> World:
    """Return the world of a name or a file.

    Args:
        text: "arena", "empty", or the path of a map's YAML file, an SDF or Gazebo world, a URDF, or a worlds file
            (JSON).
        world_name: Name of the world in a file of several, the first where empty; elsewhere, empty or the world's name.

    Raises:
        ValueError: There is no such world, or the file is malformed; the text names it.
        OSError: The file cannot be opened.
    """
    world = _load(text, world_name)
    if world_name not in ("", text, world.name):
        raise ValueError(f"world '{text}' has no world '{world_name}'; it is one alone, named '{world.name}'")
    return world


def _load(text: str, world_name: str) -> World:
    if text in BUILT_IN:
        return BUILT_IN[text]()
    ending = os.path.splitext(text)[1].lower()
    if ending not in READERS:
        endings: List[str] = sorted(READERS)
        raise ValueError(
            f"world '{text}' is not known; it must be arena, empty or a file that ends in {', '.join(endings)}"
        )
    if not os.path.isfile(text):
        raise ValueError(f"world file {os.path.abspath(text)} does not exist")
    try:
        return leveled(READERS[ending](text, world_name))
    except (RecursionError, LookupError, TypeError, AttributeError, ArithmeticError) as error:  # unforeseen content
        raise ValueError(f"world file {text} is malformed: {type(error).__name__}: {error}") from error
