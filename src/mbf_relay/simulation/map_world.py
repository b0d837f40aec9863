"""Worlds made from occupancy maps: every occupied cell becomes a piece of wall."""

from __future__ import annotations

import os
from typing import Dict, List, Tuple

import numpy as np

from mbf_relay.distances import distances_to_zeros
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import CHECK_THRESHOLDS, FREE, OccupancyMap, load_map
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Mesh
from mbf_relay.simulation.world import World

WALL_HEIGHT = 0.5
"""Height (m) of walls made of map cells."""
OCCUPIED_FROM = 65
"""Occupancy (%) from which on a cell is a wall, as by map_server's default; maps in scale mode have values between."""


def read_map_world(path: str) -> World:
    """Return the world of a map's YAML file.

    Raises:
        ValueError: The file is malformed, or the map has no free cell; the text names it.
        OSError: The file or its image cannot be opened.
    """
    occupancy = load_map(path)
    try:
        return map_world(os.path.splitext(os.path.basename(path))[0], occupancy)
    except ValueError as error:
        raise ValueError(f"map file {path}: {error}") from error


def map_world(name: str, occupancy: OccupancyMap) -> World:
    """Return the world of a map; the robot starts at the map frame's origin, else where the clearance is largest.

    Raises:
        ValueError: The map has no free cell.
    """
    free = occupancy.data == FREE
    if not free.any():
        raise ValueError(f"the map has no free cell for the robot; {CHECK_THRESHOLDS}")
    walls = occupancy.data >= OCCUPIED_FROM
    bodies: Tuple[Body, ...] = ()
    if walls.any():
        bodies = (Body("wall", Mesh(wall_triangles(walls, occupancy.resolution)), Frame.from_pose(occupancy.origin)),)
    return World(name, bodies, _start(occupancy, free))


def wall_triangles(walls: np.ndarray, resolution: float, height: float = WALL_HEIGHT) -> np.ndarray:
    """Return the surface of walls as triangles, shape (N, 3, 3) in metres, from the lower left corner of the map.

    Only sides between wall and free cells are made. Sides in line are joined, and tops are joined to few rectangles: a
    building of a million cells becomes some thousand triangles.

    Args:
        walls: Shape (height, width) bool.
        resolution: Side of a cell (m).
        height: Height of the walls (m).
    """
    rows, firsts, lasts = _boundary_runs(walls)
    along_x = _upright(np.column_stack((firsts, rows, lasts, rows)) * resolution, height)
    columns, firsts, lasts = _boundary_runs(walls.T)
    along_y = _upright(np.column_stack((columns, firsts, columns, lasts)) * resolution, height)
    return np.concatenate((along_x, along_y, _level(merged_rectangles(walls) * resolution, height)))


def merged_rectangles(walls: np.ndarray) -> np.ndarray:
    """Cover the occupied cells with few rectangles that do not overlap.

    Runs of a row are joined with equal runs of the row below, as far up as they go.

    Args:
        walls: Shape (height, width) bool.

    Returns:
        Shape (R, 4): first column, first row, last column + 1, last row + 1.
    """
    open_runs: Dict[Tuple[int, int], int] = {}
    rectangles: List[Tuple[int, int, int, int]] = []
    height = len(walls)
    padded = np.pad(walls.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(padded, axis=1)
    for row in range(height + 1):
        runs = set()
        if row < height:
            runs = set(zip(np.flatnonzero(steps[row] == 1).tolist(), np.flatnonzero(steps[row] == -1).tolist()))
        for run in sorted(set(open_runs) - runs):
            rectangles.append((run[0], open_runs.pop(run), run[1], row))
        for run in runs:
            open_runs.setdefault(run, row)
    return np.array(rectangles, dtype=float).reshape(-1, 4)


def _boundary_runs(walls: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boundaries between rows of cells, as runs: row, first column and last column + 1, shape (M,) each."""
    padded = np.pad(walls.astype(np.int8), 1)
    changes = np.diff(padded, axis=0)[:, 1:-1]
    # A run of equal, non-zero changes along a row is one side of a wall.
    starts = np.zeros((changes.shape[0], changes.shape[1] + 1), dtype=np.int8)
    starts[:, 1:-1] = changes[:, 1:] != changes[:, :-1]
    starts[:, 0] = starts[:, -1] = 1
    begins = np.argwhere((starts[:, :-1] == 1) & (changes != 0))
    ends = np.argwhere((starts[:, 1:] == 1) & (changes != 0))
    return begins[:, 0], begins[:, 1], ends[:, 1] + 1


def _upright(segments: np.ndarray, height: float) -> np.ndarray:
    """Return vertical rectangles on segments (M, 4), x, y of both ends, as triangles, shape (2 M, 3, 3)."""
    low = np.zeros((len(segments), 2, 3))
    low[:, :, :2] = segments.reshape(-1, 2, 2)
    high = low + (0.0, 0.0, height)
    return np.concatenate((
        np.stack((low[:, 0], low[:, 1], high[:, 1]), axis=1), np.stack((low[:, 0], high[:, 1], high[:, 0]), axis=1),
    ))


def _level(rectangles: np.ndarray, height: float) -> np.ndarray:
    """Return horizontal rectangles (R, 4), x, y of opposite corners, at a height as triangles, shape (2 R, 3, 3)."""
    corners = np.empty((len(rectangles), 4, 3))
    corners[:, :, :2] = rectangles[:, (0, 1, 2, 1, 2, 3, 0, 3)].reshape(-1, 4, 2)
    corners[:, :, 2] = height
    return np.concatenate((corners[:, (0, 1, 2)], corners[:, (0, 2, 3)]))


def _start(occupancy: OccupancyMap, free: np.ndarray) -> Pose2D:
    """Return the map frame's origin if it is well inside free space, else the free cell with the largest clearance."""
    room = distances_to_zeros(np.pad(free, 1))[1:-1, 1:-1] * occupancy.resolution
    local = Pose2D(0.0, 0.0, 0.0).relative_to(occupancy.origin)
    grid = occupancy.local_grid
    if grid.contains_point(local.x, local.y):
        column, row = grid.cell_at(local.x, local.y)
        if room[row, column] > 0.2:
            return Pose2D(0.0, 0.0, 0.0)
    row, column = divmod(int(np.argmax(room)), room.shape[1])
    x, y = grid.center_of(column, row)
    place = occupancy.origin.compose(Pose2D(x, y, 0.0))
    return Pose2D(place.x, place.y, 0.0)
