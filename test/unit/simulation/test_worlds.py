"""Worlds out of names and files: what is read, what is warned of, and what is refused."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Sphere
from mbf_relay.simulation.world import World
from mbf_relay.simulation.worlds import load_world
from mbf_relay.simulation.worlds_file import load_worlds_file

REPOSITORY = Path(__file__).resolve().parents[3]
SHARED = Path(os.environ.get("MBF_RELAY_SHARED", str(REPOSITORY.parent / "shared")))
BARN = SHARED / "data" / "barn_sample.json"


def write(path, text):
    path.write_text(text)
    return str(path)


def sdf(inside, version="1.6"):
    return f'<?xml version="1.0"?><sdf version="{version}"><world name="made">{inside}</world></sdf>'


def model(
    name,
    geometry,
    pose="0 0 0 0 0 0",
    link_pose="0 0 0 0 0 0",
    collision_pose="0 0 0 0 0 0",
    rest="<static>true</static>",
):
    return (
        f'<model name="{name}"><pose>{pose}</pose>{rest}<link name="link"><pose>{link_pose}</pose>'
        f'<collision name="c"><pose>{collision_pose}</pose><geometry>{geometry}</geometry></collision></link></model>'
    )


BOX = "<box><size>1 2 3</size></box>"


def loose(name, mass):
    return model(name, BOX, rest="").replace("<collision", f"<inertial><mass>{mass}</mass></inertial><collision", 1)


def test_the_arena_has_its_figures():
    world = load_world("arena")
    assert world.start == Pose2D(-2.0, -0.5, 0.0)
    pillars = [body for body in world.bodies if body.name.startswith("pillar")]
    assert len(pillars) == 9 and all(p.shape == Cylinder(0.15, 0.5) for p in pillars)
    triangles, owners = world.fixed_triangles()
    wall = triangles[owners == [body.name for body in world.bodies].index("wall")]
    assert wall[:, :, 0].max() == pytest.approx(3.3) and wall[:, :, 2].min() == pytest.approx(-0.3)
    head = [body for body in world.bodies if body.name == "head"][0].triangles()
    assert head[:, :, 0].min() == pytest.approx(3.5 - 1.173)
    assert (head[:, :, 2].min(), head[:, :, 2].max()) == pytest.approx((-0.5, 1.53))


def test_the_surface_of_a_world_is_that_of_its_bodies_one_after_the_other():
    arena = load_world("arena")
    turned = Frame.of(1.0, 2.0, 0.3, 0.1, 0.2, 0.3)
    more = [Body("ball", Sphere(0.2), turned, mass=1.0), Body("tilted", Cylinder(0.15, 0.5), turned)]
    world = World("more", (*arena.bodies[:3], *more, *arena.bodies[3:]))
    fixed = [(index, body.triangles()) for index, body in enumerate(world.bodies) if body.mass == 0.0]
    triangles, owners = world.fixed_triangles()
    assert (triangles == np.concatenate([surface for _, surface in fixed])).all()
    assert owners.tolist() == [index for index, surface in fixed for _ in surface]
    assert [len(part) for part in World("nothing", tuple(more[:1])).fixed_triangles()] == [0, 0]
    with pytest.raises(ValueError, match="read-only"):
        triangles[0] = 0.0


@pytest.mark.parametrize("text, said", [
    ("aren", "world 'aren' is not known; it must be arena, empty or a file"),
    ("nowhere/x.yaml", "x.yaml does not exist"),
    ("world.blend", "must be arena, empty or a file that ends in"),
])
def test_unknown_worlds_are_refused(text, said):
    with pytest.raises(ValueError, match=said):
        load_world(text)


def test_who_names_a_world_and_forgets_the_file_is_not_tested_in_the_arena(tmp_path):
    """The name was passed over: a test of a hard world drove through the arena instead, and passed."""
    with pytest.raises(ValueError, match="world 'arena' has no world 'maze_7'; it is one alone, named 'arena'"):
        load_world("arena", "maze_7")
    hall = write(tmp_path / "hall.world", sdf(model("crate", BOX)))
    with pytest.raises(ValueError, match="has no world 'maze_7'"):
        load_world(hall, "maze_7")
    assert load_world(hall, load_world(hall).name).bodies and load_world("arena", "arena").bodies


def test_sdf_solids_and_nested_poses(tmp_path):
    text = sdf(
        model("a", BOX, pose="1 2 0 0 0 1.5707963267948966", link_pose="1 0 0 0 0 0", collision_pose="0 1 0.5 0 0 0")
        + model("b", "<cylinder><radius>0.2</radius><length>0.6</length></cylinder>")
        + model("c", "<sphere><radius>0.3</radius></sphere>")
        + "<model name='outer'><static>1</static><pose>5 0 0 0 0 0</pose>"
        + model("inner", BOX, pose="0 1 0 0 0 0")
        + "</model>"
    )
    world = load_world(write(tmp_path / "w.world", text))
    bodies = {body.name: body for body in world.bodies}
    assert world.name == "made" and set(bodies) == {"a", "b", "c", "outer/inner"}
    # The link one ahead of a model that looks along +y, the collision one to the left of that.
    assert bodies["a"].frame.position == pytest.approx([0.0, 3.0, 0.5])
    assert bodies["a"].shape == Box((1.0, 2.0, 3.0)) and bodies["b"].shape == Cylinder(0.2, 0.6)
    assert bodies["outer/inner"].frame.position == pytest.approx([5.0, 1.0, 0.0])
    assert isinstance(bodies["c"].shape, Sphere)


def test_sdf_loose_models_have_their_mass(tmp_path):
    world = load_world(write(tmp_path / "w.sdf", sdf(loose("crate", "2.5"))))
    assert [(body.name, body.mass) for body in world.bodies] == [("crate", 2.5)]


def test_sdf_includes_are_found_on_the_model_path(tmp_path, monkeypatch):
    folder = tmp_path / "models" / "crate"
    folder.mkdir(parents=True)
    write(folder / "model.config", "<model><sdf version='1.6'>crate.sdf</sdf></model>")
    write(folder / "crate.sdf", "<sdf version='1.6'>" + model("crate", BOX, pose="9 9 9 0 0 0") + "</sdf>")
    path = write(tmp_path / "w.world", sdf(
        "<include><uri>model://crate</uri><name>first</name><pose>1 2 3 0 0 0</pose></include>"
        "<include><uri>model://crate</uri></include>"
    ))
    elsewhere = tmp_path / "else" / "where"
    elsewhere.mkdir(parents=True)
    moved = write(elsewhere / "w.world", Path(path).read_text())
    monkeypatch.setenv("HOME", str(tmp_path / "none"))
    monkeypatch.delenv("GAZEBO_MODEL_PATH", raising=False)
    with pytest.raises(ValueError, match="'model://crate' was not found .*GAZEBO_MODEL_PATH"):
        load_world(moved)
    assert len(load_world(path).bodies) == 2
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere{os.pathsep}{tmp_path / 'models'}")
    bodies = load_world(moved).bodies
    assert [(b.name, b.frame.position.tolist()) for b in bodies] == [("first", [1, 2, 3]), ("crate", [9, 9, 9])]


def test_gazebos_ground_and_sun_need_no_files(tmp_path):
    uris = ("model://ground_plane", "model://sun", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane")
    text = sdf("".join(f"<include><uri>{uri}</uri></include>" for uri in uris) + model("a", BOX))
    world = load_world(write(tmp_path / "w.world", text))
    assert [body.name for body in world.bodies] == ["a"] and not world.warnings


def test_sdf_saved_state_moves_models(tmp_path):
    text = sdf(model("a", BOX) + "<state world_name='made'><model name='a'><pose>4 5 6 0 0 0</pose></model></state>")
    assert load_world(write(tmp_path / "w.world", text)).bodies[0].frame.position == pytest.approx([4, 5, 6])


def test_sdf_poses_relative_to_something(tmp_path):
    text = sdf(
        "<model name='m'><static>1</static><pose>1 0 0 0 0 0</pose><link name='a'><pose>0 1 0 0 0 "
        "0</pose></link><link name='b'><pose relative_to='a'>0 0 1 0 0 0</pose><collision "
        f"name='c'><geometry>{BOX}</geometry></collision></link></model>",
        "1.7",
    )
    assert load_world(write(tmp_path / "w.sdf", text)).bodies[0].frame.position == pytest.approx([1, 1, 1])


def test_sdf_names_what_it_does_not_understand_once(tmp_path):
    text = sdf(
        "<actor name='x'/><actor name='y'/><light name='sun'/><physics type='ode'/>"
        + model("hill", "<heightmap><uri>x</uri></heightmap>") + model("floor", "<plane><normal>0 0 1</normal></plane>")
        + model("ramp", "<plane><normal>0 1 1</normal></plane>") + model("a", BOX)
    )
    world = load_world(write(tmp_path / "w.world", text))
    assert [body.name for body in world.bodies] == ["a"]
    assert len(world.warnings) == 3
    for word, warning in zip(("<actor>", "<heightmap> of model 'hill'", "<plane> of model 'ramp'"), world.warnings):
        assert word in warning


@pytest.mark.parametrize("text, said", [
    ("<sdf><world>", "is no XML"),
    ("<robot/>", "is no SDF: it begins with <robot>"),
    ("<sdf version='1.6'/>", "holds neither a <world> nor a <model>"),
    (sdf(model("a", "<box><size>1 2</size></box>")), "model 'a': '1 2' must be 3 finite numbers"),
    (sdf(model("a", "<box><size>1 0 1</size></box>")), "model 'a': box size"),
    (sdf(model("a", "<cylinder><radius>nan</radius><length>1</length></cylinder>")), "'nan' must be 1 finite number"),
    (sdf(loose("a", "-1")), "model 'a': <mass> '-1' must not be below 0"),
    (sdf(loose("a", "nan")), "model 'a': <mass> 'nan' must be 1 finite number"),
    (sdf(loose("a", "heavy")), "model 'a': <mass> 'heavy' must be 1 finite number"),
    (sdf(model("a", "<mesh><uri>file://gone.stl</uri></mesh>")), "model 'a': 'file://gone.stl' was not found"),
    (sdf(model("a", "<mesh><uri>model://gone/x.dae</uri></mesh>")), "set GAZEBO_MODEL_PATH"),
    (sdf(model("a", "<mesh><uri>http://x/y.stl</uri></mesh>")), "only model://, package:// and file://"),
])
def test_malformed_sdf_is_refused_in_one_line(tmp_path, text, said):
    path = write(tmp_path / "w.world", text)
    with pytest.raises(ValueError) as caught:
        load_world(path)
    assert said in str(caught.value) and path in str(caught.value) and "\n" not in str(caught.value)


CUBE_CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def cube_stl(path, binary):
    triangles = [[CUBE_CORNERS[f[0]], CUBE_CORNERS[f[i]], CUBE_CORNERS[f[i + 1]]] for f in CUBE_FACES for i in (1, 2)]
    if binary:
        data = b"x" * 80 + struct.pack("<I", 12)
        for triangle in triangles:
            data += struct.pack("<12fH", 0, 0, 0, *[value for corner in triangle for value in corner], 0)
        path.write_bytes(data)
    else:
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t)
            + "endloop\nendfacet\n"
            for t in triangles
        )
        path.write_text(f"solid cube\n{facets}endsolid cube\n")


def cube_obj(path):
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_CORNERS] + [
        "f " + " ".join(f"{i + 1}/1/1" for i in f) for f in CUBE_FACES
    ]
    path.write_text("\n".join(lines))


def cube_collada(path, up="Z_UP", meter="1", kind="polylist"):
    numbers = " ".join(f"{v}" for corner in CUBE_CORNERS for v in corner)
    if kind == "polylist":
        faces = (
            "<polylist count='6'><input semantic='VERTEX' source='#v' offset='0'/><input semantic='NORMAL' "
            "source='#n' offset='1'/>"
            f"<vcount>{'4 ' * 6}</vcount><p>{' '.join(f'{i} 0' for f in CUBE_FACES for i in f)}</p></polylist>"
        )
    else:
        triples = [i for f in CUBE_FACES for i in (f[0], f[1], f[2], f[0], f[2], f[3])]
        faces = f"<triangles count='12'><input semantic='VERTEX' source='#v' offset='0'/><p>{' '.join(map(str, triples))}</p></triangles>"
    path.write_text(
        "<COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
        f"<asset><unit meter='{meter}'/><up_axis>{up}</up_axis></asset><library_geometries><geometry id='g'><mesh>"
        f"<source id='p'><float_array id='pa' count='24'>{numbers}</float_array></source>"
        "<vertices id='v'><input semantic='POSITION' "
        f"source='#p'/></vertices>{faces}</mesh></geometry></library_geometries>"
        "<library_visual_scenes><visual_scene id='s'><node><translate>0 0 2</translate><scale>1 1 3</scale>"
        "<instance_geometry url='#g'/></node></visual_scene></library_visual_scenes></COLLADA>"
    )


@pytest.mark.parametrize("name, make, size, corner", [
    ("a.stl", lambda p: cube_stl(p, True), (1, 1, 1), (0, 0, 0)),
    ("a.stl", lambda p: cube_stl(p, False), (1, 1, 1), (0, 0, 0)),
    ("a.obj", cube_obj, (1, 1, 1), (0, 0, 0)),
    ("a.dae", cube_collada, (1, 1, 3), (0, 0, 2)),
    ("a.dae", lambda p: cube_collada(p, kind="triangles", meter="0.5"), (0.5, 0.5, 1.5), (0, 0, 1)),
    ("a.dae", lambda p: cube_collada(p, up="Y_UP"), (1, 1, 3), (0, 0, 2)),
])
def test_meshes_are_read_and_scaled(tmp_path, name, make, size, corner):
    make(tmp_path / name)
    text = sdf(model("m", f"<mesh><uri>file://{name}</uri><scale>2 1 1</scale></mesh>"))
    triangles = load_world(write(tmp_path / "w.world", text)).bodies[0].triangles()
    assert len(triangles) == 12
    lower, upper = triangles.reshape(-1, 3).min(axis=0), triangles.reshape(-1, 3).max(axis=0)
    assert upper - lower == pytest.approx(np.array(size) * (2, 1, 1))
    assert lower == pytest.approx(np.array(corner) * (2, 1, 1))


@pytest.mark.parametrize(
    "name, text",
    [
        ("a.stl", "solid\nvertex 1 2\nendsolid"),
        ("a.obj", "v 0 0 0\nf 1 2 9"),
        ("a.dae", "<COLLADA><library_"),
        ("a.stl", ""),
        ("a.dae", "<COLLADA/>"),
        ("a.fbx", "x"),
    ],
)
def test_malformed_meshes_are_named(tmp_path, name, text):
    write(tmp_path / name, text)
    path = write(tmp_path / "w.world", sdf(model("m", f"<mesh><uri>{name}</uri></mesh>")))
    with pytest.raises(ValueError, match=f"mesh .*{name}"):
        load_world(path)


def test_urdf_links_stand_where_their_joints_put_them(tmp_path):
    text = (
        "<robot name='hall'><link name='base'/><link name='post'><collision><origin xyz='0 0 0.5'/><geometry>"
        "<cylinder radius='0.1' length='1'/></geometry></collision></link>"
        "<link name='arm'><collision><geometry><box size='1 1 1'/></geometry></collision></link>"
        "<joint name='j' type='fixed'><parent link='base'/><child link='post'/><origin xyz='1 2 0' rpy='0 0 "
        "1.5707963267948966'/></joint>"
        "<joint name='k' type='fixed'><parent link='post'/><child link='arm'/><origin xyz='1 0 0'/></joint></robot>"
    )
    bodies = {b.name: b for b in load_world(write(tmp_path / "w.urdf", text)).bodies}
    assert bodies["post"].frame.position == pytest.approx([1, 2, 0.5])
    assert bodies["arm"].frame.position == pytest.approx([1, 3, 0])


@pytest.mark.parametrize(
    "text, said",
    [
        ("<robot", "is no XML"),
        ("<sdf/>", "is no URDF"),
        (
            "<robot><link name='a'><collision><geometry><box size='1 x 1'/></geometry></collision></link></robot>",
            "'1 x 1'",
        ),
        (
            "<robot><link name='a'><collision><geometry><mesh "
            "filename='package://gone/a.stl'/></geometry></collision></link></robot>",
            "package://gone/a.stl",
        ),
    ],
)
def test_malformed_urdf_is_refused(tmp_path, text, said):
    path = write(tmp_path / "w.urdf", text)
    with pytest.raises(ValueError) as caught:
        load_world(path)
    assert said in str(caught.value) and path in str(caught.value)


def worlds_json(**changes):
    world = {"name": "w", "cylinders": [[1.0, 0.0, 0.2, 0.5]], "start": [0.0, 0.0, 0.0]}
    world.update(changes)
    return json.dumps({"worlds": [world, {**world, "name": "v", "cylinders": []}]})


def test_worlds_files(tmp_path):
    mover = {"box": [0.4, 0.2, 0.5], "waypoints": [[0, 1, 1, 0], [2, 3, 1, 1.0]], "loop": False, "name": "cart"}
    path = write(
        tmp_path / "w.json",
        worlds_json(goal=[2, 0, 0], time_limit=30, boxes=[[0, 2, 0.5, 1, 1, 1]], movers=[mover], colour=1),
    )
    world = load_world(path)
    assert (world.name, len(world.bodies), world.goal, world.time_limit) == ("w", 2, Pose2D(2, 0, 0), 30.0)
    assert world.movers[0].frame_at(1.0).flat() == pytest.approx((2.0, 1.0, 0.5))
    assert "'colour'" in world.warnings[0]
    assert [body.name for body in load_world(path, "v").bodies] == ["v_box_0"]
    with pytest.raises(ValueError, match="has no world 'u'; it has w, v"):
        load_world(path, "u")


def test_a_mover_s_slips_are_told_as_a_world_s_are(tmp_path):
    """Who was to walk by once ("loop": "false") came round for ever, and "loops" was passed over in silence."""
    mover = {"radius": 0.2, "height": 1.7, "waypoints": [[0, 1, 1], [2, 3, 1]]}
    world = load_world(write(tmp_path / "w.json", worlds_json(movers=[mover, {**mover, "loops": False}])))
    assert world.warnings == ("'loops' of mover 1 of world w is not understood",)
    path = write(tmp_path / "w.json", worlds_json(movers=[{**mover, "loop": "false"}]))
    with pytest.raises(ValueError, match="world w: loop of mover 0 is 'false'; it must be true or false"):
        load_world(path)


@pytest.mark.parametrize(
    "text, said",
    [
        ("{", "no JSON"),
        ("[]", "worlds"),
        ("{\"worlds\": []}", "worlds"),
        (worlds_json(cylinders=[[1, 2, 3]]), "4 finite numbers"),
        (worlds_json(cylinders=[[1, 2, 0, 1]]), "above 0"),
        (worlds_json(start=[0, 0]), "start"),
        (worlds_json(time_limit=-1), "time_limit"),
        (worlds_json(cylinders=3), "cylinders"),
        (worlds_json(movers=[{"waypoints": [[0, 0, 0]]}]), "mover 0"),
        (worlds_json(movers=[{"radius": 0.1, "height": 1.0, "waypoints": [[1, 0, 0]]}]), "start at 0 and rise"),
    ],
)
def test_malformed_worlds_files_are_refused(tmp_path, text, said):
    path = write(tmp_path / "w.json", text)
    with pytest.raises(ValueError) as caught:
        load_world(path)
    assert said in str(caught.value) and path in str(caught.value)


def test_who_gives_batch_a_gazebo_world_is_told_what_makes_a_worlds_file_of_it(tmp_path):
    path = write(tmp_path / "yard.world", "<sdf/>")
    with pytest.raises(ValueError, match="yard.world is no JSON: .*; make_worlds.py makes worlds files of Gazebo's"):
        load_worlds_file(Path(path))


@pytest.mark.skipif(not BARN.exists(), reason="the shared data is not here")
def test_the_sample_worlds_are_read():
    world = load_world(str(BARN), "barn_001")
    assert len(world.bodies) > 100 and world.goal is not None and world.reference_path_length > 1.0


@pytest.mark.parametrize("world, place, warned", [
    ("arena", dict(x_pos=50.0), True), ("arena", dict(y_pos=-4.0), True), ("arena", dict(x_pos=2.0, y_pos=0.5), False),
    ("arena", {}, False), ("empty", dict(x_pos=50.0), False)])
def test_whoever_sets_the_robot_down_beside_the_world_is_told_so(world, place, warned):
    """It saw nothing there, was lost, and nothing told why."""
    warnings = SimulatorParameters(**place).placed(load_world(world)).warnings
    assert [("look at x_pos and y_pos" in text, "starts at (" in text) for text in warnings] == [(True, True)] * warned
