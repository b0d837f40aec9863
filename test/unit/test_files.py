"""Files from outside end in one sentence: broken, huge, endless, or no files at all."""

import json
import math
import os
import random
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tally import how_many, trial

from mbf_relay import files, maps
from mbf_relay.localization.logs import load_log
from mbf_relay.simulation.description import urdf_of
from mbf_relay.simulation.mesh_files import read_mesh
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.worlds import load_world

CONFIG = Path(__file__).resolve().parents[2] / "config"
LAUNCHED = Path(__file__).resolve().parents[1] / "launch_files"
SENTENCES = (OSError, ValueError)
"""What every node and command prints as one line."""


def map_yaml(**changes):
    values = dict(
        image="m.pgm", resolution=0.05, origin=[0.0, 0.0, 0.0], negate=0, occupied_thresh=0.65, free_thresh=0.196
    )
    return json.dumps({**values, **changes})


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return str(path)


READERS = {
    "map.yaml": maps.load_map,
    "world.world": load_world,
    "world.sdf": load_world,
    "world.urdf": load_world,
    "world.json": load_world,
    "mesh.obj": read_mesh,
    "mesh.dae": read_mesh,
    "mesh.stl": read_mesh,
    "log.npz": load_log,
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_nobody_writes_to_does_not_hold_up_a_node(tmp_path, name):
    path = str(tmp_path / name)
    os.mkfifo(path)
    with pytest.raises(SENTENCES):
        READERS[name](path)


def test_a_map_whose_image_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "m.pgm")
    with pytest.raises(maps.MapImageError, match="no regular file"):
        maps.load_map(write(tmp_path / "m.yaml", map_yaml()))


BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{name}: &{name} [{','.join(['*' + last] * 10)}]\n" for last, name in zip("abcdefgh", "bcdefghi"))
MERGES = "a0: &a0 {k: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 40))


@pytest.mark.parametrize("text", [BOMB + "origin: *i\n", MERGES, "a: &a [*a]\n", "[" * 100000, "{a: " * 5000])
def test_a_yaml_bomb_is_refused_at_once(tmp_path, text):
    with pytest.raises(maps.MapFileError):
        maps.load_map(write(tmp_path / "m.yaml", text))


@pytest.mark.parametrize("text, degrees", [
    ("!degrees 60.0", 60.0), ("deg(60)", 60.0), ("deg(-22.5)", -22.5), ("!radians pi/2", 90.0), ("rad(2*pi)", 360.0),
    ("rad(-pi / 4 + 0)", -45.0), ("!radians 0.5", math.degrees(0.5)),
])
def test_angles_are_what_rosparam_makes_of_them(text, degrees):
    assert files.parse_yaml(f"turn: {text}")["turn"] == pytest.approx(math.radians(degrees), abs=1e-12)


@pytest.mark.parametrize("text", [
    "!radians __import__('os').abort()", "!radians open", "deg(1, 2)", "!degrees much", "rad(1/0)", "rad(2**99)", "deg()",
    "!radians '" + "+1" * 1000 + "'", "!radians [1]",
])
def test_what_stands_for_an_angle_is_calculated_and_nothing_else(text):
    with pytest.raises(ValueError):
        files.parse_yaml(f"turn: {text}")


def test_harmless_aliases_are_read():
    assert files.parse_yaml("a: &a [1, 2]\nb: *a\nc: {<<: {d: 3}}") == {"a": [1, 2], "b": [1, 2], "c": {"d": 3}}


def test_a_map_whose_image_is_a_program_is_not_run(tmp_path):
    """PostScript is one, and Pillow has Ghostscript run it."""
    Image.new("L", (4, 4)).save(str(tmp_path / "m.eps"))
    with pytest.raises(maps.MapImageError, match="it is EPS"):
        maps.load_map(write(tmp_path / "m.yaml", map_yaml(image="m.eps")))


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_map_whose_pixels_are_no_numbers_is_refused(tmp_path, value):
    Image.fromarray(np.full((2, 2), value, dtype=np.float32)).save(str(tmp_path / "m.tiff"))
    with pytest.raises(maps.MapImageError, match="no numbers"):
        maps.load_map(write(tmp_path / "m.yaml", map_yaml(image="m.tiff")))


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("kind", ["L", "1", "P", "LA", "RGB", "RGBA", "I"])
def test_a_map_of_one_pixel_of_any_kind_is_read(tmp_path, kind, mode):
    Image.new(kind, (1, 1)).save(str(tmp_path / "m.png"))
    assert maps.load_map(write(tmp_path / "m.yaml", map_yaml(image="m.png", mode=mode))).data.shape == (1, 1)


def test_a_map_too_large_for_a_planner_is_named_before_it_is_unpacked(tmp_path):
    write(tmp_path / "m.pgm", b"P5 40000 40000 255\n")
    with pytest.raises(maps.MapImageError, match="40000 x 40000"):
        maps.load_map(write(tmp_path / "m.yaml", map_yaml()))


def test_a_map_above_pillows_own_limit_is_read(tmp_path):
    width, height = 14000, 13000  # 182 million cells; Pillow refuses 178.9
    image = np.full((height, width), 254, dtype=np.uint8)
    image[0, :] = 0
    image[-1, 5] = 205
    Image.frombuffer("L", (width, height), image, "raw", "L", 0, 1).save(tmp_path / "m.pgm")
    read = maps.load_map(write(tmp_path / "m.yaml", map_yaml())).data
    assert read.shape == (height, width)
    assert (read[-1] == 100).all() and read[0, 5] == -1 and read[1, 7] == 0


@pytest.mark.parametrize("resolution", [1e-6, 0.0, 1e9])
def test_a_map_with_cells_of_no_use_is_refused(tmp_path, resolution):
    with pytest.raises(maps.MapFileError, match="resolution"):
        maps.load_map(write(tmp_path / "m.yaml", map_yaml(resolution=resolution)))


def test_a_log_that_unpacks_to_everything_is_refused(tmp_path):
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", b"")
    content = path.read_bytes()
    at = content.rindex(b"PK\x01\x02")
    path.write_bytes(content[:at + 24] + (0xfffffff0).to_bytes(4, "little") + content[at + 28:])
    with pytest.raises(ValueError, match="log"):
        load_log(str(path))


DAE = """<COLLADA><asset><unit meter="1"/></asset><library_geometries><geometry id="g"><mesh><source id="s">
<float_array>0 0 0 1 0 0 0 1 0</float_array></source><vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene>%s</visual_scene></library_visual_scenes></COLLADA>"""


def test_a_scene_that_multiplies_itself_ends_in_a_sentence(tmp_path):
    nodes = '<node id="n0"><instance_geometry url="#g"/></node>'
    nodes += "".join(
        f'<node id="n{i}"><instance_node url="#n{i - 1}"/><instance_node url="#n{i - 1}"/></node>' for i in range(1, 60)
    )
    with pytest.raises(ValueError, match="parts"):
        read_mesh(write(tmp_path / "m.dae", DAE % nodes))
    loop = '<node id="n"><instance_node url="#n"/></node>'
    with pytest.raises(ValueError, match="malformed"):
        read_mesh(write(tmp_path / "m.dae", DAE % loop))


def samples(tmp_path):
    """A sound file of each kind, with its reader."""
    write(tmp_path / "m.pgm", b"P5 4 3 255\n" + bytes(range(12)))
    np.savez(tmp_path / "log.npz", t=np.arange(3.0), odom=np.zeros((3, 3)), ranges=np.ones((3, 4)), angle_min=0.0,
             angle_increment=0.1)
    shape = '<collision name="c"><geometry><box><size>1 1 1</size></box></geometry></collision>'
    return {
        "map.yaml": (map_yaml().encode(), maps.load_map),
        "world.sdf": (
            f'<sdf version="1.6"><model name="m"><link name="l">{shape}</link></model></sdf>'.encode(),
            load_world,
        ),
        "world.urdf": (urdf_of(load_robot("burger")).encode(), load_world),
        "robot.urdf": ((LAUNCHED / "box_on_wheels.urdf").read_bytes(), load_robot),
        "world.json": ((CONFIG / "worlds" / "sample.json").read_bytes(), load_world),
        "mesh.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", read_mesh),
        "mesh.dae": (
            (
                DAE % '<node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>'
            ).encode(),
            read_mesh,
        ),
        "log.npz": ((tmp_path / "log.npz").read_bytes(), load_log),
    }


def broken(content, chance):
    """Return a file as a full disk, a bad copy or an editor leaves it."""
    content = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(content) + 1)
        what = chance.randrange(5)
        if what == 0:
            content = content[:at]
        elif what == 1:
            content[at:at] = bytes(chance.randrange(256) for _ in range(chance.randint(1, 8)))
        elif what == 2:
            del content[at:at + chance.randint(1, 20)]
        elif what == 3:
            content[at:at] = chance.choice(
                [b"1e400", b"nan", b"-1", b"<", b">", b"[", b"{", b"99999999999", b"\0", b"inf"]
            )
        else:
            content[at:at] = content[at:at + chance.randint(1, 40)]
        if not content:
            return b""
    return bytes(content)


@pytest.mark.parametrize(
    "name", ["map.yaml", "world.sdf", "world.urdf", "robot.urdf", "world.json", "mesh.obj", "mesh.dae", "log.npz"]
)
def test_a_broken_file_ends_in_a_sentence(tmp_path, name):
    content, reader = samples(tmp_path)[name]
    chance = random.Random(name)
    reader(write(tmp_path / name, content))
    for _ in range(how_many(150, 5000)):
        with trial("broken files read"):
            try:
                reader(write(tmp_path / name, broken(content, chance)))
            except SENTENCES as error:
                assert str(error)
