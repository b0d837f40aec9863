"""Worlds by name or file."""

from __future__ import annotations

from mbf_relay.simulation.arena import arena
from mbf_relay.simulation.world import World


def empty() -> World:
    """Return a world with nothing but the ground."""
    return World("empty", ())


BUILT_IN = {"arena": arena, "empty": empty}


def load_world(text: str, world_name: str = "") -> World:
    """Return the world of a name or a file.

    Args:
        text: "arena", "empty", or a file.
        world_name: Which one, in a file of several.

    Raises:
        ValueError: There is no such world, or the file is malformed; the text names it.
    """
    if text in BUILT_IN:
        return BUILT_IN[text]()
    raise ValueError(f"world '{text}' is not known; there are {', '.join(BUILT_IN)}")
