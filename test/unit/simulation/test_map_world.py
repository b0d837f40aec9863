"""Worlds out of maps: walls where the cells are, merged, and a start where there is room."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap, save_map
from mbf_relay.simulation.map_world import map_world, merged_rectangles, wall_triangles
from mbf_relay.simulation.shapes import cut
from mbf_relay.simulation.worlds import load_world


def random_map(seed, shape=(60, 80)):
    rng = np.random.RandomState(seed)
    data = np.where(rng.rand(*shape) < 0.3, OCCUPIED, FREE).astype(np.int8)
    data[rng.rand(*shape) < 0.1] = UNKNOWN
    return OccupancyMap(data, 0.05, Pose2D(-1.0, 2.0, 0.3))


@pytest.mark.parametrize("seed", range(3))
def test_rectangles_cover_the_walls_once(seed):
    walls = random_map(seed).data == OCCUPIED
    covered = np.zeros(walls.shape, dtype=int)
    for left, bottom, right, top in merged_rectangles(walls).astype(int):
        covered[bottom:top, left:right] += 1
    assert np.array_equal(covered, walls.astype(int))


@pytest.mark.parametrize("seed", range(3))
def test_walls_stand_exactly_on_the_borders_of_the_cells(seed):
    walls = random_map(seed).data == OCCUPIED
    segments, _ = cut(wall_triangles(walls, 0.05), 0.2)
    padded = np.pad(walls, 1).astype(int)
    length = 0.05 * (np.abs(np.diff(padded, axis=0)).sum() + np.abs(np.diff(padded, axis=1)).sum())
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum() == pytest.approx(length)
    middles = segments.mean(axis=1) / 0.05
    assert np.minimum(np.abs(middles - np.round(middles)).min(axis=1), 1.0).max() < 1e-6


def test_walls_are_merged():
    walls = np.zeros((1000, 1000), dtype=bool)
    walls[:5], walls[-5:], walls[:, :5], walls[:, -5:] = True, True, True, True
    walls[500:503, 100:900] = True
    assert len(merged_rectangles(walls)) <= 6 and len(wall_triangles(walls, 0.05)) < 40


def test_map_worlds(tmp_path):
    data = np.full((40, 60), FREE, dtype=np.int8)
    data[:, :2] = data[:, -2:] = data[:2] = data[-2:] = OCCUPIED
    yaml_path, _ = save_map(str(tmp_path / "hall"), OccupancyMap(data, 0.1, Pose2D(1.0, 1.0, 0.0)))
    world = load_world(yaml_path)
    assert world.name == "hall"
    # The frame's origin lies off the map, so the start is where there is most room.
    assert world.start.y == pytest.approx(3.0, abs=0.11) and 2.9 < world.start.x < 5.1
    around = map_world("m", OccupancyMap(data, 0.1, Pose2D(-3.0, -2.0, 0.0)))
    assert around.start == Pose2D(0.0, 0.0, 0.0)
    turned = map_world("m", OccupancyMap(data, 0.1, Pose2D(0.0, 0.0, math.pi / 2.0)))
    assert turned.fixed_triangles()[0][:, :, 0].min() == pytest.approx(-4.0)


def test_a_map_without_a_free_cell_is_refused(tmp_path):
    yaml_path, _ = save_map(
        str(tmp_path / "full"), OccupancyMap(np.full((5, 5), OCCUPIED, np.int8), 0.1, Pose2D(0, 0, 0))
    )
    with pytest.raises(ValueError, match="full.yaml: the map has no free cell"):
        load_world(yaml_path)
