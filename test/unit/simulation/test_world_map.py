"""Maps drawn from worlds: where their walls are, what is free, and that the one in config/ is up to date."""

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import FREE, OCCUPIED, UNKNOWN, load_map, read_map_file
from mbf_relay.simulation import world_map
from mbf_relay.simulation.arena import arena
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box
from mbf_relay.simulation.world import World
from mbf_relay.simulation.world_map import SCAN_HEIGHT, grid_around, map_of_world
from mbf_relay.simulation.world_map_command import main
from mbf_relay.simulation.world_map_kernels import flood

ARENA_MAP = Path(__file__).resolve().parents[3] / "config" / "maps" / "turtlebot3_world.yaml"
GRID = Grid(0.05, -10.0, -10.0, 384, 384)


def distances_to_surface(points, segments):
    """Return the distance (m) of each point (N, 2) to the nearest of the segments (M, 2, 2)."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    best = np.full(len(points), np.inf)
    for a, d in zip(start, way):
        share = np.clip((points - a) @ d / max(d @ d, 1e-18), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * d, axis=1))
    return best


def test_the_map_in_config_is_the_arenas():
    kept, drawn = load_map(str(ARENA_MAP)), map_of_world(arena(), GRID)
    assert np.array_equal(kept.data, drawn.data) and kept.origin == drawn.origin and kept.resolution == drawn.resolution
    values = read_map_file(str(ARENA_MAP))
    assert (values.free_thresh, values.occupied_thresh) == (0.196, 0.65)


@pytest.mark.parametrize("walls", [0.0, 0.3, 0.45, 0.9])
def test_what_is_free_is_what_is_connected_side_by_side(walls):
    rng = np.random.default_rng(1)
    for height, width in ((1, 1), (1, 40), (70, 50), (200, 300)):
        cells = (rng.random((height, width)) >= walls).astype(np.uint8)
        row, column = int(rng.integers(height)), int(rng.integers(width))
        cells[row, column] = 1
        regions, _ = ndimage.label(cells)
        flood(cells, column, row)
        assert ((cells == 2) == (regions == regions[row, column])).all()


def test_a_world_too_large_to_be_drawn_at_once_has_the_same_map(monkeypatch):
    monkeypatch.setattr(world_map, "AT_ONCE", 100)
    assert np.array_equal(map_of_world(arena(), GRID).data, load_map(str(ARENA_MAP)).data)


def test_every_wall_cell_lies_on_a_surface_and_every_surface_in_reach_has_a_cell():
    world = arena()
    drawn = map_of_world(world, GRID)
    rows, columns = np.nonzero(drawn.data == OCCUPIED)
    distances = distances_to_surface(GRID.centers_of(np.column_stack((columns, rows))), world.outline(SCAN_HEIGHT))
    assert distances.max() < 0.036
    free_rows, free_columns = np.nonzero(drawn.data == FREE)
    free = distances_to_surface(GRID.centers_of(np.column_stack((free_columns, free_rows))), world.outline(SCAN_HEIGHT))
    assert free.min() > 0.015


def test_the_tutorials_goals_are_free():
    drawn = map_of_world(arena(), GRID)
    goals = [
        (-1.75, 0.74),
        (-0.36, 1.92),
        (0.957, 1.6),
        (1.8741, 0.383),
        (1.752, -0.928),
        (0.418, -2.116),
        (-0.775, -1.8),
        (-1.99, -0.508),
    ]
    for x, y in goals + [(0.5, 0.0)]:
        column, row = GRID.cell_at(x, y)
        assert drawn.data[row, column] == FREE
    for x, y in ((0.0, 0.0), (3.5, 0.0), (8.0, 8.0)):
        column, row = GRID.cell_at(x, y)
        assert drawn.data[row, column] == UNKNOWN


def room(start=Pose2D(0.0, 0.0, 0.0)):
    sides = [
        ((4.2, 0.1, 0.5), 0.0, 2.0),
        ((4.2, 0.1, 0.5), 0.0, -2.0),
        ((0.1, 4.2, 0.5), 2.0, 0.0),
        ((0.1, 4.2, 0.5), -2.0, 0.0),
    ]
    return World("room", tuple(Body("w", Box(size), Frame.of(x, y, 0.25)) for size, x, y in sides), start)


def test_a_grid_around_a_world_holds_it():
    world = room()
    drawn = map_of_world(world, grid_around(world, 0.02, margin=0.5))
    assert (drawn.data == FREE).sum() * 0.02 ** 2 == pytest.approx(3.9 ** 2, rel=0.03)
    assert drawn.data[0, 0] == UNKNOWN


@pytest.mark.parametrize(
    "start, text", [(Pose2D(2.0, 0.0, 0.0), "lies in a wall"), (Pose2D(50.0, 0.0, 0.0), "lies off the map")]
)
def test_a_start_that_is_no_place_is_refused(start, text):
    grid = Grid(0.05, -3.0, -3.0, 120, 120)
    world = (
        room(start)
        if start.x > 3.0
        else World("w", (Body("b", Box((0.06, 4.0, 1.0)), Frame.of(2.03, 0.0, 0.5)),), start)
    )
    with pytest.raises(ValueError, match=text):
        map_of_world(world, grid)


def test_who_draws_coarse_cells_is_not_told_that_the_robot_starts_in_a_wall():
    """It stood with half a metre of room, and the cell it stood in reached to a wall."""
    world = World("w", (Body("b", Box((0.1, 4.0, 1.0)), Frame.of(0.6, 0.0, 0.5)),), Pose2D(0.1, 0.1, 0.0))
    with pytest.raises(ValueError, match="lies in a cell of 1 m with a wall or another solid; give a finer res"):
        map_of_world(world, Grid(1.0, -3.0, -3.0, 6, 6))
    assert map_of_world(world, Grid(0.05, -3.0, -3.0, 120, 120)).data.any()


def test_the_command_writes_a_map_and_says_what_is_wrong(tmp_path, capsys):
    assert main(["arena", str(tmp_path / "new" / "arena"), "--size", "384", "384"]) == 0
    assert (tmp_path / "new" / "arena.pgm").read_bytes() == ARENA_MAP.with_suffix(".pgm").read_bytes()
    assert main(["nowhere", str(tmp_path / "x")]) == 1
    assert capsys.readouterr().err.startswith("world_to_map.py: world 'nowhere' is not known")


@pytest.mark.parametrize("resolution, words", [
    ("0", "--resolution is 0 m; it must be 0.001 to 50 m"), ("nan", "--resolution is nan m"), ("1e-9", "0.001 to 50 m"),
])
def test_cells_of_no_size_are_refused_in_one_line(tmp_path, capsys, resolution, words):
    assert main(["arena", str(tmp_path / "map"), "--resolution", resolution]) == 1
    assert words in (said := capsys.readouterr().err) and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_map_longer_than_any_map_server_reads_is_not_drawn(tmp_path, capsys):
    assert main(["arena", str(tmp_path / "map"), "--size", "32768", "1"]) == 1
    assert "32768 x 1 cells; at most 32767 each way" in capsys.readouterr().err and not list(tmp_path.iterdir())


@pytest.mark.parametrize("options, words", [
    (["--origin", "inf", "0", "--size", "10", "10"], "--origin: 'inf' is no finite number"),
    (["--height", "nan"], "--height: 'nan' is no finite number"),
    (["--start", "here", "0"], "--start: 'here' is no finite number"),
    (["--size", "0", "10"], "--size: 0 is below 1"),
])
def test_what_is_no_number_draws_no_map(tmp_path, capsys, options, words):
    """An endless origin ended in a traceback, and a height that is none drew an empty map."""
    with pytest.raises(SystemExit):
        main(["arena", str(tmp_path / "map"), *options])
    assert words in capsys.readouterr().err and not list(tmp_path.iterdir())
