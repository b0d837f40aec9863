"""Robots by a file: what is read, what is refused, and that each drives as its wheels allow."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.files import config_folder  # noqa: E402
from mbf_relay.geometry import Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.description import lidar_elsewhere, urdf_of  # noqa: E402
from mbf_relay.simulation.four_wheels import MecanumOdometer, mecanum_matrix  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.robot_file import load_robot, robot_of  # noqa: E402
from mbf_relay.simulation.shapes import Body, Box  # noqa: E402
from mbf_relay.simulation.world import World  # noqa: E402

NAMES = sorted(path.stem for path in (config_folder() / "robot").glob("*.yaml"))
BOX = {"body": [{"box": [0.4, 0.3, 0.2], "at": [0.0, 0.0, 0.1], "mass": 10.0}], "wheels": {"radius": 0.05}}


def simulate(name, *bodies, **changes):
    parameters = SimulationParameters.from_mapping({"robot": name, **trial.EXACT, "scan_rate": 0.0, **changes})
    return Simulation(World("test", tuple(bodies)), parameters, 1)


def numbers(text):
    return tuple(float(word) for word in text.split())


def test_a_user_s_value_goes_before_the_robot_s_and_that_before_the_default():
    assert SimulationParameters.from_mapping({"robot": "waffle"}).max_speed == 0.26
    assert SimulationParameters.from_mapping({"robot": "waffle", "max_speed": 0.1}).max_speed == 0.1
    assert SimulationParameters.from_mapping({}).max_speed == 0.22


def test_the_defaults_are_the_burger():
    assert SimulationParameters.from_mapping({"robot": "burger"}) == SimulationParameters()


@pytest.mark.parametrize("name", NAMES)
def test_it_goes_straight_turns_and_stands_where_its_wheels_say(name):
    with simulate(name) as simulation:
        speed = 0.5 * simulation.parameters.max_speed
        trial.run(simulation, 2.0, Twist2D(speed, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(speed, rel=0.03)
        assert abs(simulation.true_pose.theta) < 0.01
        radius = simulation.robot.wheels.turning_radius or 2.0 * simulation.robot.wheels.separation
        turn = min(0.5 * simulation.parameters.max_turn_rate, speed / (1.2 * radius))
        trial.run(simulation, 2.0, Twist2D(speed, 0.0, turn))
        assert simulation.true_velocity.theta == pytest.approx(turn, rel=0.04)
        assert abs(simulation.true_velocity.y) < 0.03 * speed
        trial.run(simulation, 1.0, Twist2D(speed, 0.0, -turn))
        trial.run(simulation, 2.0, Twist2D(0.0, 0.0, 0.0))
        truth, odometry = simulation.true_pose, simulation.odometry_pose
        assert odometry.distance_to(truth) < 0.05 and abs(angle_between(odometry.theta, truth.theta)) < 0.08
        trial.run(simulation, 5.0)
        assert simulation.true_pose.distance_to(truth) < 1e-4


def test_mecanum_wheels_go_sideways_and_know_it():
    with simulate("omni") as simulation:
        trial.run(simulation, 4.0, Twist2D(0.0, 0.3, 0.2))
        assert simulation.true_velocity.y == pytest.approx(0.3, rel=0.03)
        assert simulation.odometry_pose.distance_to(simulation.true_pose) < 0.02
        trial.run(simulation, 2.0, Twist2D(3.0, 3.0, 0.0))
        assert simulation.true_velocity.speed() == pytest.approx(simulation.parameters.max_speed, rel=0.03)


def test_the_odometry_s_covariance_of_mecanum_wheels_says_what_the_noise_does():
    wheels, rng, ends = load_robot("omni").wheels, np.random.Generator(np.random.PCG64(4)), []
    turned = mecanum_matrix(wheels) @ np.array([0.03, 0.02, 0.01])
    for _ in range(400):
        odometer = MecanumOdometer(wheels, 0.005, (0.0, 0.0), rng)
        for _ in range(60):
            odometer.advance(turned, 0.1)
        ends.append(odometer.pose)
    found, told = np.cov(np.array(ends).T), odometer.reading(0.0).pose_covariance
    scale = np.sqrt(np.outer(np.diag(told), np.diag(told)))
    assert np.abs((found - told) / scale).max() < 0.3


def test_a_car_does_not_turn_on_the_spot_nor_tighter_than_it_steers():
    with simulate("car") as simulation:
        trial.run(simulation, 2.0, Twist2D(0.0, 0.0, 1.0))
        assert simulation.true_pose == pytest.approx(Pose2D(0.0, 0.0, 0.0), abs=1e-3)
        trial.run(simulation, 3.0, Twist2D(0.3, 0.0, 1.0))
        velocity = simulation.true_velocity
        assert velocity.x / velocity.theta == pytest.approx(simulation.robot.wheels.turning_radius, rel=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_stopped_by_a_wall_and_says_what_it_touches(name):
    outline = load_robot(name).outline
    wall = trial.box("wall", outline[:, 0].max() + 0.6, 0.0, (0.2, 4.0, 0.8))
    with simulate(name, wall) as simulation:
        speed = simulation.parameters.max_speed
        seen = trial.run(simulation, 2.0 + 1.0 / speed, Twist2D(speed, 0.0, 0.0))
        assert {contact.name for step in seen for contact in step.contacts} == {"wall"}
        assert simulation.true_pose.x == pytest.approx(0.5, abs=0.03)


def test_a_tall_robot_does_not_drive_through_a_shelf_over_its_base():
    tall = robot_of("tall", {**BOX, "body": [
        *BOX["body"], {"box": [0.1, 0.1, 1.1], "at": [0.0, 0.0, 0.75], "mass": 0.1}]})
    shelf = Body("shelf", Box((0.4, 1.0, 0.05)), Frame.of(0.8, 0.0, 1.2))
    with Simulation(World("test", (shelf,)), SimulationParameters(), 1, robot=tall) as simulation:
        seen = trial.run(simulation, 8.0, Twist2D(0.2, 0.0, 0.0))
    assert {contact.name for step in seen for contact in step.contacts} == {"shelf"}


def test_a_wheel_that_slips_tells_of_more_way_than_there_was():
    with simulate("omni", wheel_slip=0.25) as simulation:
        trial.run(simulation, 4.0, Twist2D(0.3, 0.0, 0.0))
        assert simulation.true_pose.x < 0.8 * simulation.odometry_pose.x


def test_there_is_room_by_the_true_outline_not_by_a_box_round_it():
    post = trial.box("post", 0.09, 0.09, (0.02, 0.02, 0.5))  # in the corner of the round robot's box
    with simulate("small", post):
        pass
    with pytest.raises(ValueError, match="post"):
        simulate("small", trial.box("post", 0.065, 0.065, (0.02, 0.02, 0.5)))


@pytest.mark.parametrize("name", NAMES)
def test_its_description_has_the_frames_the_simulation_has(name):
    robot = load_robot(name)
    urdf = ElementTree.fromstring(urdf_of(robot))
    joints = {joint.get("name"): joint for joint in urdf.findall("joint")}
    children = {joint.find("child").get("link") for joint in joints.values()}
    assert children | {"base_footprint"} == {link.get("name") for link in urdf.findall("link")}
    assert numbers(joints["base_joint"].find("origin").get("xyz")) == (0.0, 0.0, robot.base_height)
    assert numbers(joints["scan_joint"].find("origin").get("xyz")) == tuple(robot.scan_in_base.position)
    assert {name for name, joint in joints.items() if joint.get("type") == "continuous"} == set(robot.joints)


@pytest.mark.parametrize("name", NAMES)
def test_odometry_does_not_notice_that_the_robot_is_set_down_elsewhere(name):
    """That of four wheels went along, at 88 m/s: localization had nothing to find."""
    with simulate(name, odom_noise=0.0) as simulation:
        trial.run(simulation, 0.5, Twist2D(0.2, 0.0, 0.0))
        before = simulation.odometry_pose
        simulation.set_pose(Pose2D(3.0, 2.0, 1.0))
        seen = [o.odometry for o in trial.run(simulation, 0.5) if o.odometry is not None]
        assert simulation.odometry_pose.distance_to(before) < 0.01
        assert max(odometry.velocity.speed() for odometry in seen) < 0.5
        assert simulation.true_pose.distance_to(Pose2D(3.0, 2.0, 1.0)) < 0.01
        simulation.reset()
        trial.run(simulation, 0.5)
        assert simulation.odometry_pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 0.01


def test_a_prism_that_does_not_lie_about_its_middle_is_shown_where_it_is_and_as_large():
    """RViz showed it twice as long and as wide, and half of it where there is nothing."""
    corners = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.2], [0.0, 0.2]]
    wedge = {"polygon": corners, "height": 0.1, "at": [0.1, 0.0, 0.1], "yaw": math.pi / 2.0, "mass": 1.0}
    told = ElementTree.fromstring(urdf_of(robot_of("wedge", {**BOX, "body": [wedge]})))
    shown = next(link for link in told.findall("link") if link.get("name") == "base_link").find("visual")
    assert numbers(shown.find("geometry/box").get("size")) == pytest.approx((0.4, 0.2, 0.1))
    assert numbers(shown.find("origin").get("xyz")) == pytest.approx((0.0, 0.2, 0.1))


@pytest.mark.parametrize("name", NAMES)
def test_the_solid_robot_fits_into_its_footprint(name):
    robot = load_robot(name)
    assert (robot.outline.min(axis=0) >= robot.footprint.min(axis=0) - 1e-9).all()
    assert (robot.outline.max(axis=0) <= robot.footprint.max(axis=0) + 1e-9).all()


@pytest.mark.parametrize("changes, said", [
    ({"drive": "hover"}, "drive is 'hover'; it must be one of differential, omnidirectional, car"),
    ({"body": []}, "body lists no box"),
    ({"body": [{"sphere": 1.0}]}, "there is no 'sphere'"),
    ({"body": [{"box": [1.0, 2.0], "mass": 1.0}]}, "box is \\[1.0, 2.0\\]; it must be a list of 3 numbers"),
    ({"body": [{"box": [1.0, 2.0, 0.1]}]}, "mass is None; it must be a number"),
    ({"wheels": {"radius": -0.1}}, "radius"),
    ({"wheels": {"radios": 0.1}}, "did you mean 'radius'"),
    ({"drive": "omnidirectional"}, "base is 0.0"),
    ({"drive": "car", "wheels": {"base": 0.3}}, "turning_radius is 0"),
    ({"footprint": [[0.0, 0.0], [1.0, 1.0]]}, "three corners"),
    ({"lidar": 3}, "lidar is 3; it must be a group"),
    ({"base_height": math.nan}, "base_height is nan"),
])
def test_a_file_that_describes_no_robot_is_refused_with_the_place(changes, said):
    with pytest.raises(ValueError, match=said):
        robot_of("wrong", {**BOX, **changes})


def test_a_robot_nobody_knows_is_refused_with_those_there_are(tmp_path):
    with pytest.raises(ValueError, match="robot 'burgre' is not known; there are burger"):
        load_robot("burgre")
    with pytest.raises(ValueError, match="cannot be read"):
        load_robot(str(tmp_path / "none.yaml"))
    (tmp_path / "odd.yaml").write_text("body: [{box: [0.4, 0.3, 0.2], mass: 1.0}]\nmax_sped: 3.0\n")
    with pytest.raises(ValueError, match="max_sped"):
        SimulationParameters.from_mapping({"robot": str(tmp_path / "odd.yaml")})


def test_a_description_that_has_the_lidar_elsewhere_than_it_measures_from_is_named():
    """A robot with a URDF of its own drove into walls: it took what it saw for behind it, and nothing told."""
    burger = load_robot("burger")
    told = urdf_of(burger)
    turned = told.replace('xyz="-0.032 0 0.172" rpy="0 0 0"', 'xyz="0.1 0 0.172" rpy="0 0 3.14159"')
    assert turned != told
    said = lidar_elsewhere(turned, "base_footprint", "base_scan", burger)
    assert "base_scan at (0.100, 0.000, 0.182, 3.142, 0.000)" in said
    assert "from (-0.032, 0.000, 0.182, 0.000, 0.000)" in said
    for tilt in (3.141, 0.209):  # the first is upside down; of either it told the same place twice
        tilted = told.replace('xyz="-0.032 0 0.172" rpy="0 0 0"', f'xyz="-0.032 0 0.172" rpy="0 {tilt} 0"')
        said = lidar_elsewhere(tilted, "robot/base_footprint", "robot/base_scan", burger)
        assert f", {tilt:.3f}), and the lidar of burger" in said
    for elsewhere in ("", "<robot", "<robot/>", told.replace('"0 0 0.01"', '"0 0 zero"')):
        assert lidar_elsewhere(elsewhere, "base_footprint", "base_scan", burger) == ""


@pytest.mark.parametrize("name", sorted(path.stem for path in (config_folder() / "robot").glob("*.yaml")))
def test_the_packages_own_descriptions_have_the_lidar_where_it_is(name):
    robot = load_robot(name)
    assert lidar_elsewhere(urdf_of(robot), "base_footprint", "base_scan", robot) == ""
