"""Gazebo's worlds as people have them: older ones, some models not there, a robot saved in them."""

import re
from pathlib import Path

import pytest

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.maps import FREE, OCCUPIED, load_map
from mbf_relay.simulation.mesh_files import read_mesh
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.shapes import Box
from mbf_relay.simulation.simulation import Simulation
from mbf_relay.simulation.world_map import grid_around, map_of_world
from mbf_relay.simulation.world_map_command import main
from mbf_relay.simulation.worlds import load_world

LIDAR_AHEAD = -0.032
"""Where (m) the burger's lidar is, before its middle."""
BOX = "<box><size>1 2 3</size></box>"


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


def sdf(inside, version="1.6", before=""):
    return f'{before}<?xml version="1.0"?><sdf version="{version}"><world name="made">{inside}</world></sdf>'


def model(name, geometry, pose="0 0 0 0 0 0", rest="<static>true</static>"):
    return (
        f'<model name="{name}"><pose>{pose}</pose>{rest}<link name="link"><collision name="c"><geometry>{geometry}'
        "</geometry></collision></link></model>")


@pytest.fixture(autouse=True)
def nothing_installed(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for variable in ("GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH"):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.parametrize("broken, told", [
    ("<include><uri>model://dumpster</uri></include>", "'model://dumpster' was not found .*GAZEBO_MODEL_PATH"),
    (model("can", "<mesh><uri>model://can/can.dae</uri></mesh>"), "model 'can': 'model://can/can.dae' was not found"),
    (model("can", "<mesh><uri>__default__</uri></mesh>"), "model 'can': '__default__' was not found"),
    (model("dot", "<sphere><radius>0</radius></sphere>"), "model 'dot': sphere radius .*; it is left out"),
    (model("dock", "<box><size>1</size></box>"), "model 'dock': '1' must be 3 finite numbers; it is left out"),
])
def test_a_hall_is_driven_in_though_one_thing_of_it_is_not_there(tmp_path, broken, told):
    """Gazebo says so and shows the rest. Here nobody could drive in the hall for want of a beverage can."""
    world = load_world(write(tmp_path / "w.world", sdf(broken + model("wall", BOX))))
    assert [body.name for body in world.bodies] == ["wall"] and len(world.warnings) == 1
    assert re.search(told, world.warnings[0])


def test_a_model_whose_own_file_is_broken_is_left_out_and_named(tmp_path):
    path = write(tmp_path / "models" / "ball" / "model.sdf", "<sdf version='1.6'><model name='ball'></sdf>")
    text = sdf("<include><uri>model://ball</uri></include>" + model("wall", BOX))
    world = load_world(write(tmp_path / "w.world", text))
    assert [body.name for body in world.bodies] == ["wall"]
    assert len(world.warnings) == 1 and path in world.warnings[0] and "left out" in world.warnings[0]


def test_whoever_lacks_gazebo_s_models_reads_one_line_and_not_sixty(tmp_path):
    text = "".join(f"<include><uri>model://chair_{i}</uri></include>" for i in range(60))
    text += "".join(model(f"hill_{i}", "<heightmap><uri>x</uri></heightmap>") for i in range(60))
    world = load_world(write(tmp_path / "w.world", sdf(text + model("wall", BOX))))
    heights, models = world.warnings
    assert "'model://chair_0', 'model://chair_1'" in models and "and 55 more were not found" in models
    assert "'hill_0', 'hill_1'" in heights and "and 55 more" in heights and "chair_9" not in models
    with pytest.raises(ValueError, match=r"w\.world: 'model://chair_0'.* and 55 more were not found"):
        load_world(write(tmp_path / "w.world", sdf(text)))


def test_what_another_simulator_s_elements_are_called_does_no_harm(tmp_path):
    text = model("bin", "<d:capsule xmlns:d='d.org'/>") + "<d:glue xmlns:d='d.org'/>" + model("wall", BOX)
    world = load_world(write(tmp_path / "w.world", sdf(text)))
    assert [body.name for body in world.bodies] == ["wall"]
    assert "<{d.org}capsule> of model 'bin' is not understood; it is left out" in world.warnings
    assert "<{d.org}glue> is not understood" in world.warnings


@pytest.mark.parametrize("before", ["<!-- who made it -->\n", "\n\n  "])
def test_a_world_that_begins_with_a_comment_is_read_as_gazebo_reads_it(tmp_path, before):
    world = load_world(write(tmp_path / "w.world", sdf(model("a", BOX), before=before)))
    assert world.bodies[0].shape == Box((1, 2, 3))


def test_a_world_of_gazebo_s_first_years_is_read(tmp_path):
    """Versions up to 1.2 have attributes where later ones have elements, which Gazebo's own later ones still read."""
    write(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    world = load_world(write(tmp_path / "w.world", sdf(
        "<model name='wall' static='true'><origin pose='0 5 0 0 0 0'/><link name='l'><origin pose='18 2 1 0 0 0'/>"
        "<collision name='c'><geometry><box size='0.2 8 2'/></geometry></collision></link></model>"
        "<model name='can'><link name='l'><inertial mass='0.5'/><collision name='c'><geometry>"
        "<cylinder radius='0.1' length='0.3'/></geometry></collision></link></model>"
        "<model name='hill' static='true'><link name='l'><collision name='c'><geometry>"
        "<mesh filename='a.obj' scale='2 2 2'/></geometry></collision></link></model>", "1.2")))
    wall, can, hill = world.bodies
    assert (wall.shape, wall.mass) == (Box((0.2, 8.0, 2.0)), 0.0)
    assert wall.frame.position == pytest.approx([18.0, 7.0, 1.0])
    assert can.mass == 0.5 and hill.triangles().max() == 2.0 and not world.warnings


@pytest.mark.parametrize("plugin", [
    "libgazebo_ros_diff_drive.so", "libDiffDrivePlugin.so", "libgazebo_ros_skid_steer_drive.so",
    "libgazebo_ros_planar_move.so", "libgazebo_ros_kobuki.so", "libhusky_gazebo_plugins.so",
    "libgazebo_ros_control.so"])
def test_the_robot_a_world_was_saved_with_does_not_stand_where_ours_is_set_down(tmp_path, plugin):
    robot = model("mobile_base", BOX, rest=f"<plugin name='base' filename='{plugin}'/>")
    gate = model("gate", BOX, rest="<static>true</static><plugin name='lamp' filename='libLedPlugin.so'/>")
    world = load_world(write(tmp_path / "w.world", sdf(robot + gate)))
    assert [body.name for body in world.bodies] == ["gate"]
    assert ["'mobile_base' is a robot" in line for line in world.warnings] == [True]


def test_a_package_that_tells_gazebo_where_its_models_are_need_not_tell_us(tmp_path, monkeypatch):
    """gazebo_ros takes what package.xml exports; without it every user had to set GAZEBO_MODEL_PATH."""
    package = tmp_path / "src" / "my_gazebo"
    write(
        package / "package.xml",
        "<package><name>my_gazebo</name><export><gazebo_ros gazebo_model_path='${prefix}/things:${prefix}/..' "
        "gazebo_media_path='${prefix}/media'/></export></package>")
    write(package / "things" / "crate" / "model.sdf", f"<sdf version='1.6'>{model('crate', BOX)}</sdf>")
    write(package / "media" / "models" / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path = write(package / "worlds" / "deep" / "w.world", sdf(
        "<include><uri>model://crate</uri></include>"
        + model("by_media", "<mesh><uri>file://models/a.obj</uri></mesh>")
        + model("by_package", "<mesh><uri>model://my_gazebo/media/models/a.obj</uri></mesh>")))
    world = load_world(path)
    assert [body.name for body in world.bodies] == ["crate", "by_media", "by_package"] and not world.warnings
    elsewhere = write(tmp_path / "elsewhere" / "w.world", Path(path).read_text())
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    assert [body.name for body in load_world(elsewhere).bodies] == ["by_package"]
    monkeypatch.setenv("GAZEBO_RESOURCE_PATH", str(package / "media"))
    assert [body.name for body in load_world(elsewhere).bodies] == ["by_media", "by_package"]
    write(package / "package.xml", "<package")
    assert len(load_world(path).warnings) == 1


def test_whoever_has_a_world_of_stage_is_told_what_to_give_instead(tmp_path):
    path = write(tmp_path / "maze.world", 'include "pioneer.inc"\nfloorplan ( name "maze" bitmap "maze.png" )\n')
    with pytest.raises(ValueError, match=r"maze\.world is no XML; where it is one of Stage, give the map"):
        load_world(path)


BEYOND = "<matrix>INF 0 0 0 NaN 1 0 0 0 0 1 0 0 0 0 1</matrix>"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("before, inside, said", [
    ("", "<rotate>0 0 0 90</rotate>", None),
    (f"<node>{BEYOND}{BEYOND}<instance_camera url='#c'/></node>", "", None),
    ("", BEYOND, "corners that are not finite"),
])
def test_a_chair_whose_file_turns_about_nothing_or_has_a_camera_beyond_all_bounds_is_there(
        tmp_path, before, inside, said):
    path = write(
        tmp_path / "a.dae",
        "<COLLADA><library_geometries><geometry id='g'><mesh><source id='p'><float_array count='9'>0 0 0 1 0 0 0 1 0"
        "</float_array></source><vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
        "<triangles count='1'><input semantic='VERTEX' source='#v' offset='0'/><p>0 1 2</p></triangles></mesh>"
        "</geometry></library_geometries>"
        f"<library_visual_scenes><visual_scene>{before}<node>{inside}<instance_geometry url='#g'/></node>"
        "</visual_scene></library_visual_scenes></COLLADA>")
    if said is None:
        assert read_mesh(path).tolist() == [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]
        return
    with pytest.raises(ValueError, match=said):
        read_mesh(path)


def test_a_map_shows_the_barrels_that_a_robot_would_have_mapped_too(tmp_path, capsys):
    """What can be pushed was not on the map: barrels and dumpsters of Gazebo's halls were missing."""
    barrel = "<cylinder><radius>0.4</radius><length>1</length></cylinder>"
    path = write(tmp_path / "w.world", sdf(
        model("barrel", barrel, "3 0 0.5 0 0 0", rest="") + model("crate", "<box><size>2 2 2</size></box>")
        + model("gone", "<mesh><uri>gone.stl</uri></mesh>")))
    assert main([path, str(tmp_path / "map")]) == 1  # within the crate: its inside would be all that is free
    assert "the start (0.0, 0.0) of world 'made' lies in a wall or another solid" in capsys.readouterr().err
    assert main([path, str(tmp_path / "map"), "--start", "1.8", "0.0"]) == 0
    assert "model 'gone': 'gone.stl' was not found" in capsys.readouterr().err
    drawn = load_map(str(tmp_path / "map.yaml"))
    column = int((3.4 - drawn.origin.x) / drawn.resolution)
    row = int((0.0 - drawn.origin.y) / drawn.resolution)
    assert OCCUPIED in drawn.data[row, column - 1:column + 2]
    assert len(load_world(path).bodies) == 2


def test_one_place_that_is_no_place_does_not_cost_the_whole_hall(tmp_path):
    text = model("wall", BOX) + model("crate", BOX, "1 1 0.1") + model("lost", BOX, "1 2") + model("far", BOX, "x y z")
    text += model("heavy", BOX, rest="").replace("<collision", "<inertial><mass>much</mass></inertial><collision")
    text += "".join(f"<include><uri>model://crate</uri><pose>{i}</pose></include>" for i in range(40))
    write(tmp_path / "models" / "crate" / "model.sdf", f"<sdf version='1.6'>{model('crate', BOX)}</sdf>")
    world = load_world(write(tmp_path / "w.world", sdf(text)))
    assert [body.name for body in world.bodies] == ["wall", "crate"]
    assert world.bodies[1].frame.position == pytest.approx([1.0, 1.0, 0.1])  # no angles are angles of 0
    told = "\n".join(world.warnings)
    for part in ("'lost': '1 2' must be 6 fin", "'far': 'x y z' must", "'heavy': <mass> 'much' must", "'39' must be 6"):
        assert part in told


def slab(size, place):
    return model("floor", f"<box><size>{size}</size></box>", f"{place} 0 0 0")


@pytest.mark.parametrize("floor, lowered", [
    (slab("20 20 0.1", "0 0 0"), 0.05),  # as Gazebo's asphalt_plane
    (slab("20 20 0.01", "5 5 0.01"), 0.015),
    (slab("20 20 0.1", "0 0 -0.05"), 0.0),
    (slab("20 20 0.1", "50 0 0"), 0.0),  # elsewhere
    (slab("1 1 0.1", "0.9 0 0"), 0.0),  # a pallet
    ("", 0.0),
])
def test_a_robot_stands_on_the_floor_it_is_set_down_on_and_drives_there(tmp_path, floor, lowered):
    """It was refused as standing in it: every third of Gazebo's halls has a floor on its ground."""
    wall = model("wall", "<box><size>0.2 4 1</size></box>", "2.1 0 0.5 0 0 0")
    world = load_world(write(tmp_path / "w.world", sdf(floor + wall)))
    assert world.bodies[-1].frame.position == pytest.approx([2.1, 0.0, 0.5 - lowered])
    if "1 1 0.1" in floor:
        return
    assert drawn_free(world) > 20.0
    with Simulation(world, SimulationParameters(), seed=1) as simulation:
        seen = driven(simulation)
        assert not any(observations.contacts for observations in seen)
        assert simulation.true_pose.x > 0.8
        ranges = [observations.scan.ranges[0] for observations in seen if observations.scan is not None]
        assert ranges[0] == pytest.approx(2.0 - LIDAR_AHEAD, abs=0.1)


def driven(simulation):
    """Return what a robot reads that drives ahead for five seconds."""
    seen = []
    for _ in range(5 * int(simulation.parameters.physics_rate)):
        simulation.set_command(Twist2D(0.2, 0.0, 0.0))
        seen.append(simulation.step())
    return seen


def drawn_free(world):
    drawn = map_of_world(world, grid_around(world, 0.05))
    return (drawn.data == FREE).sum() * 0.05 ** 2


def test_a_threshold_of_half_a_centimetre_is_rolled_over_and_one_of_three_is_not(tmp_path):
    for height, touched in ((0.008, False), (0.03, True)):
        door = model("door", f"<box><size>0.1 4 {height}</size></box>", f"0.4 0 {height / 2} 0 0 0")
        world = load_world(write(tmp_path / "w.world", sdf(door)))
        with Simulation(world, SimulationParameters(), seed=1) as simulation:
            assert any(observations.contacts for observations in driven(simulation)) is touched


def test_a_robot_is_set_down_in_a_hall_that_is_one_mesh(tmp_path):
    """Seen from within, a hall was a solid that the robot stood in the middle of."""
    corners = [(x, y) for x, y in ((-3, -3), (3, -3), (3, 3), (-3, 3))]
    lines = [f"v {x} {y} {z}" for z in (0, 2) for x, y in corners]
    lines += [f"f {i} {i % 4 + 1} {i % 4 + 5} {i + 4}" for i in range(1, 5)]
    write(tmp_path / "hall.obj", "\n".join(lines))
    world = load_world(write(tmp_path / "w.world", sdf(model("hall", "<mesh><uri>hall.obj</uri></mesh>"))))
    assert drawn_free(world) == pytest.approx(36.0, rel=0.05)
    with Simulation(world, SimulationParameters(), seed=1) as simulation, pytest.raises(ValueError, match="in 'hall'"):
        simulation.set_pose(Pose2D(3.0, 0.0, 0.0))


def test_several_models_of_one_included_file_keep_their_names_and_saved_places(tmp_path):
    """All were called as the first and put where that was saved, one into another; contacts named the wrong one."""
    pair = model("left", BOX, "0 4 0") + model("right", BOX, "0 -4 0")
    write(tmp_path / "pair.sdf", f"<sdf version='1.6'>{pair}</sdf>")
    saved = "<state><model name='left'><pose>9 4 0 0 0 0</pose></model></state>"
    world = load_world(write(tmp_path / "w.world", sdf("<include><uri>pair.sdf</uri></include>" + saved)))
    places = {body.name: body.frame.position.tolist() for body in world.bodies}
    assert places == {"left": [9.0, 4.0, 0.0], "right": [0.0, -4.0, 0.0]}
