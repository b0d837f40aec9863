"""Draws the occupancy map of a world from its geometry, as a robot would map it from its start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbf_relay.distances import around
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from mbf_relay.simulation.clearance import crosses_positive_x_axis
from mbf_relay.simulation.shapes import Mesh, cut
from mbf_relay.simulation.world import World
from mbf_relay.simulation.world_map_kernels import flood

SCAN_HEIGHT = 0.182
"""Default height (m) of the cut: that of a TurtleBot3 burger's lidar."""

ENOUGH = 0.25
"""Length of outline in a cell, relative to its side, above which it is occupied; a cell barely touched stays free."""
SAMPLES, AT_ONCE = 20.0, 1 << 18
"""Sample points per cell length of outline, and about how many are processed at once, to bound memory."""


def map_of_world(world: World, grid: Grid, height: float = SCAN_HEIGHT) -> OccupancyMap:
    """Return the map of a world in its initial state, loose bodies included.

    Cells that are connected with the start are free, cells with a surface next to free ones are occupied, and all
    others, inside bodies and behind walls, are unknown.

    Args:
        world: The world.
        grid: The map's grid.
        height: Height at which the world is cut (m).

    Raises:
        ValueError: The robot's start is outside of the grid, inside a wall or another body, or in a cell with one.
    """
    standing = _standing(world)
    walls = _cells_crossed(standing.outline(height), grid)
    if not grid.contains_point(world.start.x, world.start.y):
        raise ValueError(f"the start ({world.start.x}, {world.start.y}) of world '{world.name}' lies off the map")
    column, row = grid.cell_at(world.start.x, world.start.y)
    start = f"the start ({world.start.x}, {world.start.y}) of world '{world.name}' lies in"
    if _starts_inside(standing, height):
        raise ValueError(f"{start} a wall or another solid; give a start with room round it")
    if walls[row, column]:
        raise ValueError(
            f"{start} a cell of {grid.resolution:g} m with a wall or another solid; give a finer resolution or another "
            "start")
    cells = (~walls).astype(np.uint8)
    flood(cells, column, row)
    free = cells == 2
    reached = around(free, outside=False)
    data = np.full(grid.shape, UNKNOWN, dtype=np.int8)
    data[free] = FREE
    data[walls & reached] = OCCUPIED
    return OccupancyMap(data, grid.resolution, Pose2D(grid.origin_x, grid.origin_y, 0.0))


def grid_around(world: World, resolution: float, margin: float = 1.0, height: float = SCAN_HEIGHT) -> Grid:
    """Return a grid that covers the outline at `height` (m), start and goal, with `margin` metres around them."""
    places = [pose[:2] for pose in (world.start, world.goal) if pose is not None]
    points = np.concatenate((_standing(world).outline(height).reshape(-1, 2), places))
    lower = np.floor((points.min(axis=0) - margin) / resolution) * resolution
    columns, rows = np.ceil((points.max(axis=0) + margin - lower) / resolution).astype(int)
    return Grid(resolution, float(lower[0]), float(lower[1]), int(columns), int(rows))


def _standing(world: World) -> World:
    """Return the world with its loose bodies fixed, so that they are part of its outline."""
    if not any(body.mass for body in world.bodies):
        return world
    return replace(world, bodies=tuple(replace(body, mass=0.0) for body in world.bodies))


def _starts_inside(world: World, height: float) -> bool:
    """Return whether the start is inside a box, cylinder or sphere; meshes do not count, as they may be buildings."""
    triangles, owners = world.fixed_triangles()
    segments, whose = cut(triangles, height)
    crossed = crosses_positive_x_axis(segments - np.array(world.start[:2]))
    crossings = np.bincount(owners[whose[crossed]], minlength=len(world.bodies))
    return any(count % 2 and not isinstance(body.shape, Mesh) for count, body in zip(crossings, world.bodies))


def _cells_crossed(segments: np.ndarray, grid: Grid) -> np.ndarray:
    """Return which cells contain ENOUGH length of the segments (M, 2, 2), shape (height, width) bool."""
    held = np.zeros(grid.width * grid.height)
    ways = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(ways, axis=1)
    counts = np.ceil(lengths / (grid.resolution / SAMPLES)).astype(np.int64)
    ends = np.cumsum(counts)
    for chunk in np.split(np.arange(len(segments)), np.flatnonzero(np.diff(ends // AT_ONCE)) + 1):
        owners = np.repeat(chunk, counts[chunk])
        passed = np.arange(len(owners)) - np.repeat(np.cumsum(counts[chunk]) - counts[chunk], counts[chunk])
        shares = (passed + 0.5) / counts[owners]
        cells = grid.cells_at(segments[owners, 0] + shares[:, None] * ways[owners])
        inside = grid.contains_cells(cells)
        columns, rows = cells[inside].T
        pieces = (lengths[owners] / counts[owners])[inside]
        held += np.bincount(rows * grid.width + columns, pieces, len(held))
    return (held > ENOUGH * grid.resolution).reshape(grid.shape)
