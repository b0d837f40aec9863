"""Drives over maps as surveys leave them: made from scans, of floors with tables and chairs that are moved at times.

Maps drawn from the walls themselves are too good: at a right pose no beam passes through anything the map has, and
what was fitted to them takes a table's leg that is a cell off for proof of being lost. Here a lidar drives the way
first, its scans are laid where it is thought to be, a few centimetres and half a degree off, and the map is what they
hit more often than they pass. Then some of the furniture is moved.
"""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from benchmark.map_gaps import Condition, make_way
from benchmark.synthetic_buildings import BUILDINGS, RESOLUTION
from benchmark.synthetic_drives import as_map
from mbf_relay.grid import Grid
from mbf_relay.localization.distance_field import DistanceField, distances_to
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.stress import without_blocks
from mbf_relay.maps import OccupancyMap

TABLES = 0.06
"""Tables to a square metre of free floor."""
TABLE = (0.5, 1.6)
"""Sides (m) of a table, whose legs the lidar sees."""
MOVED = 0.15
"""Share of the tables that stand elsewhere by the time the robot is localized."""
KEPT_CLEAR = 0.4
"""Distance (m) from the way within which nothing stands."""
SURVEY_STEP, SURVEY_BEAMS, SURVEY_REACH = 0.25, 360, 8.0
"""Way (m) between the scans of a survey, their beams, and how far (m) these reach."""
SURVEY_ERROR = np.array([0.02, 0.02, 0.008])
"""Deviations (m, m, rad) of where the scans of a survey are laid."""
SEEN_ASIDE = 1.0
"""Deviation (m) of the survey's way from the robot's."""
OCCUPIED_SHARE = 0.25
"""Share of the beams at a cell that end there, from which it is occupied; gmapping's."""
BEAMS, NOISE, NOISE_PER_METRE = 240, 0.008, 0.006
"""Of the scans localized by: beams, and deviation of a range (m), at once and for each metre."""
MIXED, DROPPED = 0.01, 0.04
"""Shares of beams that end between two things, and that say nothing."""


def make_surveyed_log(building: str, seed: int, condition: Condition) -> Tuple[RecordedLog, OccupancyMap]:
    """Return a drive's log and the map to localize it on.

    Args:
        building: A key of BUILDINGS.
        seed: Of walls, furniture, way, odometry and map.
        condition: What the drive is like.
    """
    walls, way = make_way(building, seed)
    rng = np.random.default_rng([seed, list(BUILDINGS).index(building), 2])
    clear = _near(walls.shape, way.truth)
    tables = _tables(~walls & ~clear, rng)
    before, after = _placed(walls, tables, clear), _placed(walls, _moved(tables, ~walls & ~clear, rng), clear)
    occupancy = without_blocks(survey(before, way.truth, rng), condition.missing, rng)
    chosen = way.every(condition.step)
    bearings = np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    field = DistanceField(as_map(after), 2.0)
    scans = np.array([_scan(field, pose, bearings, condition.range_max, rng) for pose in way.truth[chosen]])
    return way.log(chosen, scans, bearings, condition.range_max), occupancy


def survey(world: np.ndarray, way: np.ndarray, rng: np.random.Generator) -> OccupancyMap:
    """Return the map that a survey along a way makes of a world.

    Args:
        world: What there is, bool of shape (H, W).
        way: Poses along which it goes, about, shape (N, 3).
        rng: Where chance comes from.
    """
    true_map, grid = as_map(world), _grid_over(world.shape)
    field = DistanceField(true_map, 2.0)
    hits, passes = np.zeros(world.shape), np.zeros(world.shape)
    bearings = np.arange(SURVEY_BEAMS) * (2.0 * math.pi / SURVEY_BEAMS)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way[:, :2], axis=0).T))))
    for index in np.unique(np.searchsorted(driven, np.arange(0.0, driven[-1], SURVEY_STEP))):
        pose = way[index] + rng.normal(0.0, 1.0, 3) * (SEEN_ASIDE, SEEN_ASIDE, 3.0)
        column, row = grid.cell_at(*pose[:2])
        if not grid.contains_cell(column, row) or world[row, column]:
            pose = way[index]
        ranges = _scan(field, pose, bearings, SURVEY_REACH, rng)
        _lay(pose + rng.normal(0.0, 1.0, 3) * SURVEY_ERROR, ranges, bearings, grid, hits, passes)
    seen = hits + passes > 0.0
    occupied = seen & (hits > OCCUPIED_SHARE * (hits + passes))
    data = np.where(occupied, 100, np.where(seen, 0, -1)).astype(np.int8)
    return OccupancyMap(data, RESOLUTION, true_map.origin)


def _lay(
    pose: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, grid: Grid, hits: np.ndarray, passes: np.ndarray
) -> None:
    """Count a scan, shape (B,), taken at a pose: where beams ended, and which cells they passed; changes the last two.
    """
    ended = np.isfinite(ranges)
    far = np.where(ended, ranges, 0.0)[:, None]
    along = np.arange(0.0, SURVEY_REACH, 0.7 * RESOLUTION)[None, :]
    passed = along < far - RESOLUTION
    headings = pose[2] + bearings
    directions = np.column_stack((np.cos(headings), np.sin(headings)))
    for counted, reach, chosen in ((passes, along, passed), (hits, far, ended[:, None])):
        points = np.array(pose[:2]) + reach[:, :, None] * directions[:, None, :]
        cells = grid.cells_at(points[chosen])
        columns, rows = cells[grid.contains_cells(cells)].T
        counted[rows, columns] += 1.0  # a scan counts once for a cell, however often that stands among the indices


def _grid_over(shape: Tuple[int, ...]) -> Grid:
    """Return where cells of a shape (H, W) lie on maps that `as_map` makes."""
    origin = as_map(np.zeros(shape, dtype=bool)).origin
    return Grid(RESOLUTION, origin.x, origin.y, shape[1], shape[0])


def _scan(
    field: DistanceField, pose: np.ndarray, bearings: np.ndarray, reach: float, rng: np.random.Generator
) -> np.ndarray:
    """Return what a lidar measures at a pose, shape (B,): +inf where nothing came back."""
    ranges = np.empty(len(bearings))
    cast_scan(np.array(pose)[None, :], field.blocked, field.frame, reach, bearings, ranges)
    came_back = ranges < reach
    ranges = ranges + rng.normal(0.0, 1.0, len(ranges)) * (NOISE + NOISE_PER_METRE * ranges)
    mixed = rng.random(len(ranges)) < MIXED
    ranges[mixed] -= rng.random(int(mixed.sum())) * (ranges - np.minimum(ranges, np.roll(ranges, 1)))[mixed]
    ranges[~came_back] = np.inf
    ranges[rng.random(len(ranges)) < DROPPED] = np.nan
    return ranges


def _near(shape: Tuple[int, ...], way: np.ndarray) -> np.ndarray:
    """Return which cells, bool of `shape`, are within KEPT_CLEAR of a way, shape (N, 3)."""
    grid, on_way = _grid_over(shape), np.zeros(shape, dtype=bool)
    cells = grid.cells_at(way)
    columns, rows = cells[grid.contains_cells(cells)].T
    on_way[rows, columns] = True
    near: np.ndarray = distances_to(on_way, RESOLUTION, 1.0) < KEPT_CLEAR
    return near


def _tables(free: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return tables on free cells, bool of shape (H, W): rows of row, column, and two sides, all in cells, (K, 4)."""
    cells = np.argwhere(free)
    count = int(TABLES * len(cells) * RESOLUTION ** 2)
    corners = cells[rng.integers(0, len(cells), count)]
    sides = (rng.uniform(*TABLE, (count, 2)) / RESOLUTION).astype(np.int64)
    return np.column_stack((corners, sides))


def _moved(tables: np.ndarray, free: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return tables, shape (K, 4), some of which stand elsewhere."""
    moved, cells = tables.copy(), np.argwhere(free)
    chosen = rng.random(len(tables)) < MOVED
    moved[chosen, :2] = cells[rng.integers(0, len(cells), int(chosen.sum()))]
    return moved


def _placed(walls: np.ndarray, tables: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Return walls, bool of shape (H, W), with the legs of tables, shape (K, 4), each a cell, but where it is clear."""
    world = np.zeros_like(walls)
    for row, column, high, wide in tables:
        for down, right in ((0, 0), (0, wide), (high, 0), (high, wide)):
            if row + down < world.shape[0] and column + right < world.shape[1]:
                world[row + down, column + right] = True
    return walls | (world & ~clear)

