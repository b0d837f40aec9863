"""Reads URDF files as worlds: the collision geometries of all links, with every joint at zero."""

from __future__ import annotations

import os
from typing import Dict, List, Optional
from xml.etree.ElementTree import Element

import numpy as np

from mbf_relay import files
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.mesh_files import read_mesh
from mbf_relay.simulation.resources import find_resource
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Mesh, Shape, Sphere
from mbf_relay.simulation.world import World


def read_urdf(path: str) -> World:
    """Return the world of a URDF file; the root link's frame is the world's.

    Raises:
        ValueError: The file is malformed, or a mesh is missing; the text names both.
        OSError: The file cannot be opened.
    """
    try:
        robot = files.read_xml(path)
    except ValueError as error:
        raise ValueError(f"world file {error}") from error
    if robot.tag != "robot":
        raise ValueError(f"world file {path} is no URDF: it begins with <{robot.tag}>")
    folder = os.path.dirname(os.path.abspath(path))
    bodies: List[Body] = []
    warnings: List[str] = []
    try:
        frames = link_frames(robot)
        for link in robot.findall("link"):
            name = link.get("name", "link")
            for collision in link.findall("collision"):
                shape = shape_of(collision.find("geometry"), folder)
                if shape is None:
                    warnings.append(
                        f"a collision of link '{name}' has a geometry that is not understood; it is left out"
                    )
                    continue
                bodies.append(Body(name, shape, frames[name].compose(origin_of(collision))))
        if any(joint.get("type") != "fixed" for joint in robot.findall("joint")):
            warnings.append("joints are not simulated; every link stands still with its joint at zero")
    except ValueError as error:
        raise ValueError(f"world file {path}: {error}") from error
    return World(robot.get("name") or os.path.basename(path), tuple(bodies), warnings=tuple(warnings))


def link_frames(robot: Element) -> Dict[str, Frame]:
    """Return the pose of each link in the root link's frame; raise ValueError where a joint is malformed."""
    joints = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            raise ValueError(f"joint '{joint.get('name')}' lacks parent or child")
        joints[child.get("link")] = (parent.get("link"), origin_of(joint))
    frames: Dict[str, Frame] = {}
    for link in robot.findall("link"):
        frame, name, depth = Frame.of(0.0, 0.0), link.get("name"), 0
        while name in joints:
            name, origin = joints[name]
            frame = origin.compose(frame)
            depth += 1
            if depth > len(joints):
                raise ValueError(f"link '{link.get('name')}' is its own ancestor")
        frames[link.get("name", "link")] = frame
    return frames


def shape_of(geometry: Optional[Element], folder: str) -> Optional[Shape]:
    """Return the shape of a <geometry>, None where it is unsupported; `folder` is that of the URDF, for meshes.

    Raises:
        ValueError: A number or a mesh is malformed, or the mesh is missing.
        OSError: The mesh cannot be opened.
    """
    element = next(iter(geometry), None) if geometry is not None else None
    if element is None:
        return None
    if element.tag == "box":
        return Box(tuple(numbers_of(element, "size", 3)))
    if element.tag == "cylinder":
        return Cylinder(numbers_of(element, "radius", 1)[0], numbers_of(element, "length", 1)[0])
    if element.tag == "sphere":
        return Sphere(numbers_of(element, "radius", 1)[0])
    if element.tag == "mesh":
        return Mesh(
            read_mesh(find_resource(element.get("filename", ""), folder)) * numbers_of(element, "scale", 3, "1 1 1")
        )
    return None


def origin_of(element: Element) -> Frame:
    """Return the <origin> of an element, identity where it has none; raise ValueError where it is malformed."""
    origin = element.find("origin")
    if origin is None:
        return Frame.of(0.0, 0.0)
    return Frame.of(*numbers_of(origin, "xyz", 3, "0 0 0"), *numbers_of(origin, "rpy", 3, "0 0 0"))


def numbers_of(element: Element, attribute: str, count: int, default: str = "") -> np.ndarray:
    """Return the numbers of an attribute, or of `default`, shape (count,); raise ValueError where it is malformed."""
    text = element.get(attribute, default)
    try:
        values = np.array(text.split(), dtype=float)
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(
            f"{attribute} of <{element.tag}> is '{text}'; it must be {count} finite number{'s' if count > 1 else ''}"
        )
    return values
