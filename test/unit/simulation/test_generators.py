"""Generated worlds: solvable, repeatable, measured, and read back; BARN's kind of file read."""

import json

import numpy as np
import pytest
from tally import LONG

from mbf_relay.simulation import make_worlds
from mbf_relay.simulation.difficulty import CELL, difficulty_of
from mbf_relay.simulation.generators import KINDS, generate
from mbf_relay.simulation.worlds_file import load_worlds_file

COUNT = 1000 if LONG else 30
BARN = """<sdf version="1.6"><world name="default">{models}<state world_name="default">{states}</state></world></sdf>"""
MODEL = """<model name="unit_cylinder_{i}"><static>1</static><link name="link"><collision name="collision"><geometry>
<cylinder><radius>0.075</radius><length>1</length></cylinder></geometry></collision></link></model>"""
STATE = """<model name="unit_cylinder_{i}"><pose>{x} {y} 0.5 0 0 0</pose></model>"""


@pytest.mark.parametrize("kind", KINDS)
def test_every_world_has_a_way_that_is_found_in_what_was_written(tmp_path, kind):
    count = -(-COUNT // len(KINDS))
    out = tmp_path / "worlds.json"
    assert make_worlds.main(["--kind", kind, "--count", str(count), "--out", str(out)]) == 0
    entries = json.loads(out.read_text())["worlds"]
    worlds = load_worlds_file(out)
    assert len(worlds) == count and not any(world.warnings for world in worlds)
    for entry, world in zip(entries, worlds):
        corners = world.outline(0.2).reshape(-1, 2)
        assert (corners.min(axis=0) >= -1e-6).all() and world.goal is not None
        walls = drawn(entry["boxes"])
        measured = difficulty_of(walls, world.start[:2], world.goal[:2])
        assert measured is not None, f"{world.name} has no way"
        assert measured.path_length == pytest.approx(entry["reference_path_length"], abs=1e-3)
        assert measured.path_length_ratio >= 1.0 and measured.narrowest_passage >= 0.3


def drawn(boxes):
    """Draw boxes along the axes into a grid, without what made them."""
    cells = np.array([[round((x - a / 2) / 0.15), round((y - b / 2) / 0.15), round(a / 0.15), round(b / 0.15)]
                      for x, y, _, a, b, _ in boxes])
    end = (cells[:, :2] + cells[:, 2:]).max(axis=0) + 60
    walls = np.zeros((end[1], end[0]), bool)
    for column, row, columns, rows in cells:
        walls[row:row + rows, column:column + columns] = True
    return walls


@pytest.mark.parametrize("kind", KINDS)
def test_one_seed_is_one_world(kind):
    assert generate(kind, 7) == generate(kind, 7) != generate(kind, 8)


def test_a_door_is_measured_and_a_wall_has_no_way():
    walls = np.zeros((20, 21), bool)
    walls[10] = True
    assert difficulty_of(walls, (1.5, 0.7), (1.5, 2.3)) is None
    walls[10, 9:12] = False
    measured = difficulty_of(walls, (1.575, 0.7), (1.575, 2.3))
    assert measured.narrowest_passage == pytest.approx(0.45, abs=1e-3)
    assert measured.path_length_ratio == pytest.approx(1.0, abs=0.05)


def test_a_world_without_a_wall_is_measured_in_numbers_that_a_file_can_hold():
    assert np.isfinite(difficulty_of(np.zeros((20, 20), bool), (0.5, 0.5), (2.0, 2.0))).all()


def test_worlds_in_barns_form_are_read(tmp_path):
    places = [(-4.5, 0.3 * i) for i in range(50)] + [(0.0, 0.3 * i) for i in range(50)] + [(-2.25, 8.0)]
    path = tmp_path / "world_7.world"
    path.write_text(BARN.format(
        models="".join(MODEL.format(i=i) for i in range(len(places))),
        states="".join(STATE.format(i=i, x=x, y=y) for i, (x, y) in enumerate(places)),
    ))
    assert make_worlds.main([str(path), "--out", str(tmp_path / "barn.json")]) == 0
    (world,) = load_worlds_file(tmp_path / "barn.json")
    assert world.name == "world_7" and len(world.bodies) == 101 and world.start[:2] == (-2.25, 3.0)
    assert 10.0 <= world.reference_path_length < 10.5


def test_a_blocked_or_missing_world_is_named(tmp_path, capsys):
    places = [(-5.0 + 0.1 * i, 8.0) for i in range(60)]
    path = tmp_path / "blocked.world"
    path.write_text(BARN.format(
        models="".join(MODEL.format(i=i) for i in range(len(places))),
        states="".join(STATE.format(i=i, x=x, y=y) for i, (x, y) in enumerate(places)),
    ))
    assert make_worlds.main([str(path), "--goal", "-2.25", "8.0", "0", "--out", str(tmp_path / "a.json")]) == 1
    assert "blocked.world: no way for the robot leads" in capsys.readouterr().err
    assert make_worlds.main([str(tmp_path / "none.world"), "--out", str(tmp_path / "a.json")]) == 1
    assert f"make_worlds.py: {tmp_path / 'none.world'}: No such file or directory" in capsys.readouterr().err


@pytest.mark.parametrize("static", [0, 1])
def test_the_way_leads_round_what_could_be_pushed_in_gazebo(tmp_path, static):
    """In a worlds file all stands fast. The way to score by led through crates, and no robot got full marks."""
    path = tmp_path / "crate.world"
    path.write_text(BARN.format(models=f"""<model name="crate"><static>{static}</static><pose>0 2 0.5 0 0 0</pose>
        <link name="l"><collision name="c"><geometry><box><size>4 0.2 1</size></box></geometry></collision></link>
        </model>""", states=""))
    ends = ["--start", "0", "0", "0", "--goal", "0", "4", "0"]
    assert make_worlds.main([str(path), *ends, "--out", str(tmp_path / "made.json")]) == 0
    entry, = json.loads((tmp_path / "made.json").read_text())["worlds"]
    assert entry["reference_path_length"] > 6.0 and entry["difficulty"]["mean_clearance"] < 1.2


def test_two_files_of_one_name_and_a_goal_at_the_start_are_refused(tmp_path, capsys):
    """Of two folders of Gazebo worlds a file was made that batch.py refuses; a goal at the start showed a traceback."""
    paths = [tmp_path / folder / "hall.world" for folder in ("one", "two")]
    for path in paths:
        path.parent.mkdir()
        path.write_text(BARN.format(models=MODEL.format(i=0), states=STATE.format(i=0, x=0.0, y=0.0)))
    out = tmp_path / "made.json"
    assert make_worlds.main([*map(str, paths), "--out", str(out)]) == 1
    assert f"{paths[0]} and {paths[1]} would both be the world 'hall'" in capsys.readouterr().err
    assert make_worlds.main([str(paths[0]), "--goal", "-2.25", "3", "0", "--out", str(out)]) == 1
    assert "hall.world: start and goal, (-2.25, 3.0) and (-2.25, 3.0), are one place" in capsys.readouterr().err
    assert not out.exists()


def test_what_a_gazebo_world_loses_on_the_way_is_told(tmp_path, capsys):
    """Of a yard with a ramp the ramp was left out, and whoever compared planners there was not told."""
    path = tmp_path / "yard.world"
    ramp = ('<model name="ramp"><static>1</static><link name="l"><collision name="c"><geometry><heightmap/></geometry>'
            "</collision></link></model>")
    path.write_text(BARN.format(models=MODEL.format(i=0) + ramp, states=STATE.format(i=0, x=0.0, y=0.0)))
    assert make_worlds.main([str(path), "--out", str(tmp_path / "made.json")]) == 0
    assert capsys.readouterr().err.splitlines() == [
        f"make_worlds.py: {path}: <heightmap> of model 'ramp' is not understood; it is left out"]


@pytest.mark.parametrize("x, y, z, tilt, is_refused", [
    (0.0, 0.0, 0.5, 0.0, False), (0.0, 0.0, 0.0, 0.0, False), (0.0, 0.0, 1.5, 0.0, True), (0.0, 0.0, 0.5, 1.57, True),
    (0.0, 0.0, -2.0, 0.0, True)], ids=["on the ground", "half in it", "in the air", "lying", "under the ground"])
def test_what_a_worlds_file_cannot_say_of_a_world_is_refused(tmp_path, capsys, x, y, z, tilt, is_refused):
    """A bar that the robot drives under became a wall to the ground, and one that lies a pillar."""
    state = STATE.format(i=0, x=x, y=y).replace("0.5 0 0 0", f"{z} {tilt} 0 0")
    path = tmp_path / "world.world"
    path.write_text(BARN.format(models=MODEL.format(i=0), states=state))
    assert make_worlds.main([str(path), "--out", str(tmp_path / "made.json")]) == int(is_refused)
    if is_refused:
        assert "'unit_cylinder_0' does not stand upright on the ground" in capsys.readouterr().err
    else:
        entry, = json.loads((tmp_path / "made.json").read_text())["worlds"]
        assert entry["cylinders"] == [[x, y, 0.075, pytest.approx(z + 0.5)]]


@pytest.mark.parametrize("cells", range(3, 9))
def test_a_passage_is_as_wide_as_it_is_whether_its_cells_are_odd_or_even(cells):
    """Of an even number of cells 6 cm were missing: its middle lies between two of the cells that were looked at."""
    walls = np.ones((30, 20), bool)
    walls[:10, 1:-1] = walls[-10:, 1:-1] = False
    walls[10:-10, 2:2 + cells] = False
    for turned in (walls, walls.T):
        start, goal = (1.6, 0.8), (1.6, 3.7)
        if turned is not walls:
            start, goal = start[::-1], goal[::-1]
        assert difficulty_of(turned, start, goal).narrowest_passage == pytest.approx(cells * CELL, abs=1e-3)
