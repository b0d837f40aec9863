"""The robot's description and the simulation agree on every number."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from mbf_relay.simulation import burger, clearance

URDF = Path(__file__).resolve().parents[3] / "config" / "robot" / "burger.urdf"


@pytest.fixture(scope="module")
def robot():
    return ElementTree.parse(str(URDF)).getroot()


def numbers(text):
    return tuple(float(word) for word in text.split())


def origin(element):
    return numbers(element.find("origin").get("xyz"))


def link(robot, name):
    return robot.find(f"link[@name='{name}']")


def joint(robot, name):
    return robot.find(f"joint[@name='{name}']")


def test_frames_stand_where_the_simulation_has_them(robot):
    assert origin(joint(robot, "base_joint")) == (0.0, 0.0, burger.BASE_HEIGHT)
    assert origin(joint(robot, "scan_joint")) == tuple(burger.SCAN_IN_BASE.position)
    assert origin(joint(robot, "imu_joint")) == tuple(burger.IMU_IN_BASE.position)
    for name, side in (("wheel_left_joint", 1), ("wheel_right_joint", -1)):
        assert origin(joint(robot, name)) == (0.0, side * burger.WHEEL_SEPARATION / 2.0, burger.WHEEL_HEIGHT)
    assert burger.BASE_HEIGHT + burger.WHEEL_HEIGHT == pytest.approx(burger.WHEEL_RADIUS)


def test_every_frame_hangs_on_base_footprint(robot):
    children = {j.find("child").get("link") for j in robot.findall("joint")}
    names = {"base_link", "wheel_left_link", "wheel_right_link", "caster_back_link", "imu_link", "base_scan"}
    assert children == names and {e.get("name") for e in robot.findall("link")} == names | {"base_footprint"}
    assert {j.get("name") for j in robot.findall("joint") if j.get("type") == "continuous"} == set(burger.JOINTS)


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_sizes(robot, kind):
    body = link(robot, "base_link").find(kind)
    assert numbers(body.find("geometry/box").get("size")) == burger.BODY_SIZE and origin(body) == burger.BODY_CENTER
    wheel = link(robot, "wheel_left_link").find(f"{kind}/geometry/cylinder")
    assert (float(wheel.get("radius")), float(wheel.get("length"))) == (burger.WHEEL_RADIUS, burger.WHEEL_WIDTH)
    lidar = link(robot, "base_scan").find(kind)
    cylinder = lidar.find("geometry/cylinder")
    assert (float(cylinder.get("radius")), float(cylinder.get("length"))) == (burger.LIDAR_RADIUS, burger.LIDAR_HEIGHT)
    assert burger.SCAN_IN_BASE.position[0] + origin(lidar)[0] == pytest.approx(burger.LIDAR_CENTER[0])
    caster = link(robot, "caster_back_link").find(kind)
    assert numbers(caster.find("geometry/box").get("size")) == burger.CASTER_SIZE
    assert origin(joint(robot, "caster_back_joint")) == burger.CASTER_CENTER


def test_masses(robot):
    for name, mass in (("base_link", burger.BODY_MASS), ("wheel_left_link", burger.WHEEL_MASS), ("base_scan", burger.LIDAR_MASS)):
        assert float(link(robot, name).find("inertial/mass").get("value")) == mass
    inertia = link(robot, "base_link").find("inertial/inertia")
    assert tuple(float(inertia.get(axis)) for axis in ("ixx", "iyy", "izz")) == burger.BODY_INERTIA


def test_the_solid_robot_fits_into_the_tutorials_footprint():
    xs, ys = zip(*burger.FOOTPRINT)
    assert clearance.LOWER[0] >= min(xs) and clearance.UPPER[0] <= max(xs)
    assert clearance.LOWER[1] >= min(ys) and clearance.UPPER[1] <= max(ys)
