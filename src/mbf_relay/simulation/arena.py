"""The tutorials' arena (TurtleBot3's "turtlebot3_world"): nine pillars in a hexagonal wall, with five blocks at it.

The dimensions are those of TurtleBot3's model.
"""

from __future__ import annotations

from typing import List

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Cylinder, Mesh, prism_triangles, regular_polygon, ring_triangles
from mbf_relay.simulation.world import World

START = Pose2D(-2.0, -0.5, 0.0)
"""The robot's start in TurtleBot3's launch file (m, rad)."""

CIRCLE = (
    (-1.75, 0.74, 0.539, 0.843), (-0.36, 1.92, -0.020, 0.999), (0.957, 1.60, -0.163, 0.987),
    (1.8741, 0.3830, -0.70, 0.711), (1.752, -0.928, -0.856, 0.517), (0.418, -2.116, 0.998, 0.0619),
    (-0.775, -1.80, 0.954, 0.300), (-1.990, -0.508, -0.112, 0.999),
)
"""The tutorial's goals in `map`: x, y (m) and the quaternion's z, w, rounded as in the tutorial."""

PILLAR_RADIUS, PILLAR_HEIGHT = 0.15, 0.5
"""Metres."""
PILLAR_GRID = (-1.1, 0.0, 1.1)
"""x and y (m) of the pillars' centres."""
RING_INNER, RING_OUTER, RING_BOTTOM, RING_TOP = 2.933, 3.300, -0.3, 0.97
"""Inner and outer circumradius of the hexagonal wall, its lower and upper end (m)."""
BLOCKS = (
    ("head", 3.5, 0.0, 1.173, -0.5, 1.53),
    ("front_left_block", 1.8, 2.7, 0.8066, 0.0, 1.40),
    ("front_right_block", 1.8, -2.7, 0.8066, 0.0, 1.40),
    ("rear_left_block", -1.8, 2.7, 0.8066, 0.0, 1.40),
    ("rear_right_block", -1.8, -2.7, 0.8066, 0.0, 1.40),
)
"""Name, x, y, circumradius, bottom, top (m) of the hexagonal prisms, whose corners are at 0, 60, ... degrees."""

WHITE, GREEN = (0.93, 0.93, 0.90, 1.0), (0.35, 0.62, 0.33, 1.0)


def arena() -> World:
    """Return the arena as a world, without goals."""
    bodies: List[Body] = []
    for x in PILLAR_GRID:
        for y in PILLAR_GRID:
            frame = Frame.of(x, y, PILLAR_HEIGHT / 2.0)
            bodies.append(
                Body(f"pillar_{len(bodies) + 1}", Cylinder(PILLAR_RADIUS, PILLAR_HEIGHT), frame, colour=WHITE)
            )
    ring = Mesh(ring_triangles(regular_polygon(RING_INNER, 6), regular_polygon(RING_OUTER, 6), RING_BOTTOM, RING_TOP))
    bodies.append(Body("wall", ring, Frame.of(0.0, 0.0), colour=GREEN))
    for name, x, y, radius, bottom, top in BLOCKS:
        block = Mesh(prism_triangles(regular_polygon(radius, 6), bottom, top))
        bodies.append(Body(name, block, Frame.of(x, y), colour=GREEN))
    return World("arena", tuple(bodies), START)
