"""robot_description: a URDF derived from the robot's file, and a check of another URDF against the simulated robot."""

from __future__ import annotations

import math
from typing import Dict, Tuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from mbf_relay.files import parse_xml
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.robot import BASE_FRAME, FOOTPRINT_FRAME, IMU_FRAME, SCAN_FRAME, RobotModel
from mbf_relay.simulation.shapes import Box, Cylinder, Shape, Sphere
from mbf_relay.simulation.urdf import link_frames

AGREES = 0.02
"""Tolerance for the lidar's pose in a description: metres, and difference of the rotation matrices' entries."""

COLOURS: Dict[str, str] = {"dark": "0.25 0.25 0.27 1.0", "black": "0.08 0.08 0.08 1.0"}


def lidar_elsewhere(description: str, base_frame: str, scan_frame: str, robot: RobotModel) -> str:
    """Return a warning if a description has the lidar at another pose than the simulated robot; else empty.

    Nodes transform scans by the description, so that all obstacles would be displaced.

    Args:
        description: A URDF; for one that is malformed or lacks these frames, nothing is returned.
        base_frame: The robot's base frame on the ground, with its tf prefix.
        scan_frame: The lidar's frame, likewise.
        robot: The simulated robot.
    """
    try:
        frames = link_frames(parse_xml(description, "robot_description"))
        base, scan = (frames[name.rpartition("/")[2]] for name in (base_frame, scan_frame))
    except (ValueError, KeyError):
        return ""
    measured = Frame.of(0.0, 0.0, robot.base_height).compose(robot.scan_in_base)
    told = base.inverse().compose(scan)
    turned = np.abs(told.rotation - measured.rotation).max()
    off = np.abs(told.position - measured.position)
    # a description whose root is base_link may have its origin on the ground
    off[2] = min(off[2], abs(told.position[2] - robot.scan_in_base.position[2]))
    if max(turned, off.max()) <= AGREES:
        return ""
    return (
        f"robot_description has {scan_frame} at {_place(told)}, and the lidar of {robot.name}, which is simulated, "
        f"measures from {_place(measured)} (x, y, z, yaw, tilt in {base_frame}): all that is seen will seem to be "
        "elsewhere; give as robot a .yaml that has it there, see config/robot, where it looks level and upright")


def _place(frame: Frame) -> str:
    tilt = math.acos(max(-1.0, min(1.0, float(frame.rotation[2, 2]))))
    return f"({', '.join(f'{value:.3f}' for value in (*frame.position, frame.flat().theta, tilt))})"


def urdf_of(robot: RobotModel) -> str:
    """Return a robot's URDF: base_footprint, base_link, a link for each wheel, and the sensors' frames."""
    root = Element("robot", name=robot.name)
    for name, rgba in COLOURS.items():
        SubElement(SubElement(root, "material", name=name), "color", rgba=rgba)
    SubElement(root, "link", name=FOOTPRINT_FRAME)
    _joint(root, "base_joint", (FOOTPRINT_FRAME, BASE_FRAME), Frame.of(0.0, 0.0, robot.base_height))
    base = SubElement(root, "link", name=BASE_FRAME)
    for index, part in enumerate(robot.body):
        _solid(base, part.shape, part.frame, "black" if index else "dark")
    for caster in robot.casters:
        _solid(
            base, Sphere(caster.radius), Frame.of(caster.x, caster.y, caster.radius - robot.base_height), "black"
        )
    _inertial(base, robot)
    tyre = Cylinder(robot.wheels.radius, robot.wheels.width)
    names = list(robot.joints) + [f"wheel_front_{side}_joint" for side in ("left", "right")]  # the last two for a car
    for name, (x, y) in zip(names, robot.wheel_places()):
        link = name.replace("_joint", "_link")
        hub = Frame.of(x, y, robot.axle_height)
        _joint(root, name, (BASE_FRAME, link), hub, name in robot.joints)
        _solid(SubElement(root, "link", name=link), tyre, Frame.of(0.0, 0.0), "black")
    for name, frame, place in (
        ("imu_joint", IMU_FRAME, robot.imu_in_base), ("scan_joint", SCAN_FRAME, robot.scan_in_base)
    ):
        _joint(root, name, (BASE_FRAME, frame), place)
        SubElement(root, "link", name=frame)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _joint(root: Element, name: str, ends: Tuple[str, str], place: Frame, turns: bool = False) -> None:
    """Add a joint.

    Args:
        root: Root element of the URDF.
        name: The joint's name.
        ends: Parent and child link.
        place: Pose of the child in the parent; of a wheel, without the rotation of its axis.
        turns: Whether it is a driven wheel's joint, which is continuous about the axis to the left.
    """
    joint = SubElement(root, "joint", name=name, type="continuous" if turns else "fixed")
    SubElement(joint, "parent", link=ends[0])
    SubElement(joint, "child", link=ends[1])
    wheel = name.startswith("wheel")
    roll = -math.pi / 2.0 if wheel else 0.0
    yaw = place.flat().theta
    SubElement(joint, "origin", xyz=_words(place.position), rpy=f"{roll:.9g} 0 {yaw:.9g}")
    if turns:
        SubElement(joint, "axis", xyz="0 0 1")


def _solid(link: Element, shape: Shape, place: Frame, material: str) -> None:
    """Add a solid to a link, as <visual> and <collision>.

    Args:
        link: The link's element.
        shape, place: The solid, and its pose in the link.
        material: One of COLOURS.
    """
    if not isinstance(shape, (Box, Cylinder, Sphere)):  # a prism: its bounding box, as URDF meshes need a file
        lowest, highest = (f(shape.triangles().reshape(-1, 3), axis=0) for f in (np.min, np.max))
        middle, sides = (lowest + highest) / 2.0, (highest - lowest).tolist()
        shape, place = Box((sides[0], sides[1], sides[2])), Frame(place.transform_points(middle), place.rotation)
    for kind in ("visual", "collision"):
        element = SubElement(link, kind)
        SubElement(element, "origin", xyz=_words(place.position), rpy=f"0 0 {place.flat().theta:.9g}")
        geometry = SubElement(element, "geometry")
        if isinstance(shape, Cylinder):
            SubElement(geometry, "cylinder", radius=f"{shape.radius:.9g}", length=f"{shape.height:.9g}")
        elif isinstance(shape, Sphere):
            SubElement(geometry, "sphere", radius=f"{shape.radius:.9g}")
        else:
            SubElement(geometry, "box", size=_words(shape.size))
        if kind == "visual":
            SubElement(element, "material", name=material)


def _inertial(link: Element, robot: RobotModel) -> None:
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=_words(robot.body[0].frame.position), rpy="0 0 0")
    SubElement(inertial, "mass", value=f"{sum(part.mass for part in robot.body):.9g}")
    x, y, z = robot.inertia
    SubElement(inertial, "inertia", ixx=f"{x:.9g}", iyy=f"{y:.9g}", izz=f"{z:.9g}", ixy="0", ixz="0", iyz="0")


def _words(numbers: object) -> str:
    return " ".join(f"{float(number):.9g}" for number in numbers)  # type: ignore[attr-defined]
