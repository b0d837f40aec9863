"""The tutorials' arena, as data: nine pillars in a hexagonal ring that five hexagonal blocks cut into.

The figures are read off the description of TurtleBot3's "turtlebot3_world".
"""

from __future__ import annotations

from typing import List

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Cylinder, Mesh, prism_triangles, regular_polygon, ring_triangles
from mbf_relay.simulation.world import World

START = Pose2D(-2.0, -0.5, 0.0)

PILLAR_RADIUS, PILLAR_HEIGHT = 0.15, 0.5
PILLAR_GRID = (-1.1, 0.0, 1.1)
RING_INNER, RING_OUTER, RING_BOTTOM, RING_TOP = 2.933, 3.300, -0.3, 0.97
BLOCKS = (
    ("head", 3.5, 0.0, 1.173, -0.5, 1.53),
    ("front_left_block", 1.8, 2.7, 0.8066, 0.0, 1.40),
    ("front_right_block", 1.8, -2.7, 0.8066, 0.0, 1.40),
    ("rear_left_block", -1.8, 2.7, 0.8066, 0.0, 1.40),
    ("rear_right_block", -1.8, -2.7, 0.8066, 0.0, 1.40),
)
"""Name, x, y, circumradius, bottom, top (m) of the hexagonal prisms; their corners stand at 0, 60, ... degrees."""

WHITE, GREEN = (0.93, 0.93, 0.90, 1.0), (0.35, 0.62, 0.33, 1.0)


def arena() -> World:
    """Return the arena."""
    bodies: List[Body] = []
    for x in PILLAR_GRID:
        for y in PILLAR_GRID:
            frame = Frame.of(x, y, PILLAR_HEIGHT / 2.0)
            bodies.append(Body(f"pillar_{len(bodies) + 1}", Cylinder(PILLAR_RADIUS, PILLAR_HEIGHT), frame, colour=WHITE))
    ring = Mesh(ring_triangles(regular_polygon(RING_INNER, 6), regular_polygon(RING_OUTER, 6), RING_BOTTOM, RING_TOP))
    bodies.append(Body("wall", ring, Frame.of(0.0, 0.0), colour=GREEN))
    for name, x, y, radius, bottom, top in BLOCKS:
        block = Mesh(prism_triangles(regular_polygon(radius, 6), bottom, top))
        bodies.append(Body(name, block, Frame.of(x, y), colour=GREEN))
    return World("arena", tuple(bodies), START)
