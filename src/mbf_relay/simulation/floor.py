"""The floor of a Gazebo world: a slab or mesh on the ground plane, on which the robot starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, level
from mbf_relay.simulation.world import World

HIGHEST = 0.3
"""Largest height (m) of a floor above the ground plane; higher surfaces count as furniture."""
LEAST_AREA = 4.0
"""Least area (m^2) of a floor; smaller surfaces count as crates or pallets."""
EVEN = 0.005
"""Difference in height (m) up to which two surfaces are one floor."""


def leveled(world: World) -> World:
    """Return a world lowered so that the floor under the robot's start is at height 0, where the ground plane is."""
    height = floor_height(world)
    if height == 0.0:
        return world
    bodies = tuple(_lowered(body, height) for body in world.bodies)
    movers = tuple(replace(mover, body=_lowered(mover.body, height)) for mover in world.movers)
    return replace(world, bodies=bodies, movers=movers)


def floor_height(world: World) -> float:
    """Return the height (m) of the floor under the robot's start above the ground plane; 0 where there is none."""
    triangles = world.fixed_triangles()[0]
    heights = triangles[:, 0, 2]
    low = (heights > 0.0) & (heights <= HIGHEST)
    flat = triangles[low][level(triangles[low])]
    under = flat[_above(flat, world.start.x, world.start.y)][:, 0, 2]
    for height in sorted(under.tolist(), reverse=True):
        floor = flat[np.abs(flat[:, 0, 2] - height) < EVEN]
        sides = np.diff(floor[:, :, :2], axis=1)
        area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum()
        if area >= LEAST_AREA:
            return float(height)
    return 0.0


def _above(triangles: np.ndarray, x: float, y: float) -> np.ndarray:
    """Return which triangles, shape (N, 3, 3), contain a point x, y seen from above, shape (N,) bool."""
    ends = np.roll(triangles, -1, axis=1)
    sides = (ends[:, :, 0] - triangles[:, :, 0]) * (y - triangles[:, :, 1])
    sides -= (ends[:, :, 1] - triangles[:, :, 1]) * (x - triangles[:, :, 0])
    above: np.ndarray = (sides >= 0.0).all(axis=1) | (sides <= 0.0).all(axis=1)
    return above


def _lowered(body: Body, height: float) -> Body:
    return replace(body, frame=Frame(body.frame.position - (0.0, 0.0, height), body.frame.rotation))
