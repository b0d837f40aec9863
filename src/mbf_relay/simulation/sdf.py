"""Reads SDF and Gazebo `.world` files, as far as they say what a robot can collide with or see.

Supported are models and links with their poses (also `relative_to` a sibling frame, link or model), includes, the
models' poses of a saved `<state>`, and the collision geometries box, cylinder, sphere, plane and mesh. What is
unsupported, missing or broken is left out with a warning, as in Gazebo, as long as some body is left.
"""

from __future__ import annotations

import os
from typing import Dict, List, Optional, Tuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from mbf_relay import files
from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.mesh_files import read_mesh
from mbf_relay.simulation.remarks import Remarks
from mbf_relay.simulation.resources import MissingResource, find_resource, model_file
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Mesh, Shape, Sphere
from mbf_relay.simulation.world import World

DRIVES = ("diffdrive", "skidsteer", "planarmove", "ackermann", "mecanum", "kobuki", "husky", "roscontrol", "motor")
"""Parts of the file names of Gazebo plugins that drive a robot; a model with one is left out of the world."""
PASSED_OVER = {
    "physics", "light", "scene", "gui", "gravity", "magnetic_field", "atmosphere", "audio", "wind",
    "spherical_coordinates", "state", "plugin", "pose", "frame", "name", "static", "self_collide", "enable_wind",
    "allow_auto_disable", "link", "model", "include", "joint", "visual", "inertial", "sensor", "collision", "uri",
    "road", "gripper", "kinematic", "velocity_decay", "must_be_base_link", "mass", "inertia", "material_name",
    "projector", "battery", "audio_source", "audio_sink",
}
"""Elements that are read elsewhere or do not concern collisions; there is no warning of them."""
ALWAYS_THERE = ("ground_plane", "sun")
"""Models of Gazebo that are not read: the simulator has a ground plane, and needs no light."""
MOST_INCLUDES = 10000
"""Largest number of files included: files that each include another one twice would take for ever."""
FLAT = 0.999
"""Cosine of the largest tilt of a <plane> that counts as the ground."""
SOON = 200
"""Bytes of a file within which its first element must begin."""
BY_ATTRIBUTES = ("1.0", "1.1", "1.2")
"""Versions of SDF that have attributes where later ones have elements."""


def read_sdf(path: str) -> World:
    """Return the world of an SDF or Gazebo world file; a file with models alone is a world, too.

    Raises:
        ValueError: The file is malformed, or nothing of it can be read; the text says why.
        OSError: The file cannot be opened.
    """
    try:
        return SdfReader(path).world()
    except ValueError as error:
        if path in str(error):
            raise
        raise ValueError(f"world file {path}: {error}") from error


class SdfReader:
    """Reads one file and what it includes."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._bodies: List[Body] = []
        self._remarks = Remarks()
        self._meshes: Dict[str, np.ndarray] = {}
        self._saved: Dict[str, Frame] = {}  # poses of the world's models by their names, from its <state>
        self._depth = self._includes = 0

    def world(self) -> World:
        """Return the world; errors as for `read_sdf`."""
        root = self._parse(self._path)
        worlds = root.findall("world")
        if len(worlds) > 1:
            self._remarks.warn("several worlds in one file: only the first is taken")
        top = worlds[0] if worlds else root
        if not worlds and not root.findall("model"):
            raise ValueError(f"world file {self._path} holds neither a <world> nor a <model>")
        self._saved = {m.get("name", ""): pose_of(m) for m in top.findall("state/model") if m.find("pose") is not None}
        self._children(top, Frame.of(0.0, 0.0), os.path.dirname(os.path.abspath(self._path)), "")
        name = top.get("name") or os.path.splitext(os.path.basename(self._path))[0]
        lost = self._remarks.lost()
        if lost and not self._bodies:
            raise ValueError(f"world file {self._path}: {'; '.join(lost)}")
        return World(name, tuple(self._bodies), Pose2D(0.0, 0.0, 0.0), warnings=tuple(self._remarks.lines()))

    def _parse(self, path: str) -> Element:
        with files.open_regular(path) as file:
            text = file.read()
        if b"<" not in text[:SOON]:
            raise ValueError(
                f"world file {path} is no XML; where it is one of Stage, give the map of its floor plan as the world")
        declaration = text.find(b"<?xml")
        if declaration > 0:  # after a comment or an empty line, which Gazebo's parser accepts
            text = text[:declaration] + text[declaration:].partition(b"?>")[2]
        try:
            root = files.parse_xml(text, path)
        except ValueError as error:
            raise ValueError(f"world file {error}") from error
        if root.tag not in ("sdf", "gazebo"):
            raise ValueError(f"world file {path} is no SDF: it begins with <{root.tag}>")
        if root.get("version") in BY_ATTRIBUTES:
            _of_attributes(root)
        return root

    def _children(self, parent: Element, frame: Frame, folder: str, prefix: str) -> None:
        """Read models and includes of a world or a model.

        Args:
            parent: The world or the model.
            frame: Its pose in the world.
            folder: Folder of its file, to which paths are relative.
            prefix: What the names of its models begin with: "" for a world, "NAME/" for a model.
        """
        frames = _Frames(parent, frame)
        for child in parent:
            if child.tag in ("model", "include"):
                try:
                    if child.tag == "include":
                        self._include(child, frames, folder, prefix)
                    else:
                        place = self._place(child.get("name", ""), prefix, child, frames)
                        self._model(child, place, folder, prefix, _is_static(child))
                except _Endless:
                    raise
                except MissingResource as error:
                    self._remarks.leave_out(error)
                except ValueError as error:
                    whose = child.get("name", child.findtext("uri", "model"))
                    self._remarks.leave_out(error, f"model '{prefix}{whose}': ")
            elif child.tag not in PASSED_OVER:
                self._remarks.warn("{} is not understood", f"<{child.tag}>")

    def _place(self, name: str, prefix: str, element: Element, frames: _Frames) -> Frame:
        """Return a model's pose in the world: as saved in the world's <state>, else the one that an element gives."""
        saved = None if prefix else self._saved.get(name)
        return self._placed(element, frames) if saved is None else saved

    def _placed(self, element: Element, frames: _Frames) -> Frame:
        """Return the pose of an element in the world; warn where it is relative to an unknown frame."""
        try:
            return frames.placed(element)
        except KeyError as error:
            self._remarks.warn(
                "pose of {} is relative to an unknown frame, and taken as relative to its parent",
                f"'{element.get('name', element.tag)}' ({error})")
            return frames.parent.compose(pose_of(element))

    def _include(self, include: Element, frames: _Frames, folder: str, prefix: str) -> None:
        uri = (include.findtext("uri") or "").strip()
        if uri.rstrip("/").rpartition("/")[2].lower().replace(" ", "_") in ALWAYS_THERE:
            return
        found = find_resource(uri, folder)
        file = model_file(found) if os.path.isdir(found) else found
        renamed = (include.findtext("name") or "").strip()
        models = self._parse(file).findall("model")
        self._depth += 1
        self._includes += 1
        if self._includes > MOST_INCLUDES:
            raise _Endless(f"world file {self._path} includes more than {MOST_INCLUDES} files")
        if self._depth > 30:
            raise _Endless(f"world file {self._path}: '{uri}' includes itself")
        try:
            for model in models:
                name = renamed or model.get("name", "model")
                # The include's pose replaces the model's own.
                place = self._place(name, prefix, include if include.find("pose") is not None else model, frames)
                model.set("name", name)
                is_static = _is_static(include) or _is_static(model)
                self._model(model, place, os.path.dirname(os.path.abspath(file)), prefix, is_static)
        finally:
            self._depth -= 1

    def _model(self, model: Element, frame: Frame, folder: str, prefix: str, is_static: bool) -> None:
        name = prefix + model.get("name", "model")
        if not prefix and any(part in _letters(plugin) for plugin in model.iter("plugin") for part in DRIVES):
            self._remarks.warn("model {} is a robot; it is left out, since the simulator adds its own", f"'{name}'")
            return
        links = model.findall("link")
        loose = not is_static and len(links) == 1 and not model.findall("joint") and not model.findall("model")
        if not is_static and not loose and links:
            self._remarks.warn(
                "model {} has several links; it stands still, since joints are not simulated", f"'{name}'")
        frames = _Frames(model, frame)
        for link in links:
            self._link(link, self._placed(link, frames), folder, f"{name}/{link.get('name', 'link')}", loose, name)
        self._children(model, frame, folder, name + "/")

    def _link(self, link: Element, frame: Frame, folder: str, path: str, loose: bool, name: str) -> None:
        frames = _Frames(link, frame)
        collisions = link.findall("collision")
        solids: List[Tuple[Frame, Shape]] = []
        for collision in collisions:
            shape = self._geometry(collision.find("geometry"), self._placed(collision, frames), folder, name)
            if shape is not None:
                solids.append((self._placed(collision, frames), shape))
        mass = 0.0
        if loose and solids:
            mass = self._mass(link)
            if len(solids) > 1:
                self._remarks.warn("model {} has several collisions in one link; it stands still", f"'{name}'")
                mass = 0.0
        for index, (place, shape) in enumerate(solids):
            own = name if len(solids) == 1 else f"{path}/{collisions[index].get('name', index)}"
            self._bodies.append(Body(own, shape, place, mass))

    def _mass(self, link: Element) -> float:
        """Return the mass (kg) of a link; 1 where none is given, as in Gazebo."""
        if link.find("inertial/mass") is None:
            return 1.0
        try:
            mass = _number(link, "inertial/mass")
            if mass < 0.0:
                raise ValueError(f"'{mass:g}' must not be below 0")
        except ValueError as error:
            raise ValueError(f"<mass> {error}") from error
        return mass

    def _geometry(self, geometry: Optional[Element], frame: Frame, folder: str, name: str) -> Optional[Shape]:
        """Return a collision's shape; None for the ground plane and for unsupported geometries."""
        element = next((child for child in geometry if child.tag != "empty"), None) if geometry is not None else None
        if element is None:
            return None
        try:
            if element.tag == "box":
                return Box(tuple(_numbers(element.findtext("size"), 3)))
            if element.tag == "cylinder":
                return Cylinder(_number(element, "radius"), _number(element, "length"))
            if element.tag == "sphere":
                return Sphere(_number(element, "radius"))
            if element.tag == "mesh":
                return self._mesh(element, folder, name)
        except ValueError as error:
            self._remarks.leave_out(error, f"model '{name}': ")
            return None
        if element.tag == "plane":
            normal = frame.rotation @ _numbers(element.findtext("normal") or "0 0 1", 3)
            if normal[2] < FLAT * np.linalg.norm(normal) or abs(frame.position[2]) > 1e-3:
                self._remarks.warn("<plane> of model {} is not the ground at height 0; it is left out", f"'{name}'")
            return None
        self._remarks.warn(f"<{element.tag}> of model {{}} is not understood; it is left out", f"'{name}'")
        return None

    def _mesh(self, element: Element, folder: str, name: str) -> Mesh:
        if element.find("submesh") is not None:
            self._remarks.warn("<submesh> of model {} is not understood; the whole mesh is taken", f"'{name}'")
        path = find_resource((element.findtext("uri") or element.findtext("filename") or "").strip(), folder)
        if path not in self._meshes:
            self._meshes[path] = read_mesh(path)
        return Mesh(self._meshes[path] * _numbers(element.findtext("scale") or "1 1 1", 3))


class _Endless(ValueError):
    """Files include each other without end; an error for the whole world."""


class _Frames:
    """Resolves poses of an element's children, also relative to each other, to the world."""

    def __init__(self, element: Element, parent: Frame) -> None:
        self.parent = parent
        self._named = {
            child.get("name"): child
            for child in element
            if child.tag in ("link", "model", "frame", "joint") and child.get("name")
        }

    def placed(self, element: Element, depth: int = 0) -> Frame:
        """Return the pose of a child in the world.

        Raises:
            KeyError: It is relative to a frame that is no sibling.
        """
        pose = element.find("pose")
        reference = pose.get("relative_to", pose.get("frame", "")) if pose is not None else ""
        if not reference:
            reference = element.get("attached_to", "")
        if not reference or reference in ("__model__", "world"):
            return self.parent.compose(pose_of(element))
        if depth > 50 or reference not in self._named:
            raise KeyError(reference)
        return self.placed(self._named[reference], depth + 1).compose(pose_of(element))


def _is_static(element: Element) -> bool:
    return (element.findtext("static") or "").strip().lower() in ("1", "true")


def _of_attributes(root: Element) -> None:
    """Convert a file of an old version in place: attributes become the elements of later versions."""
    for element in list(root.iter()):
        if element.tag == "origin":
            element.tag = "pose"
            element.text = element.attrib.pop("pose", "")
        for name in set(element.attrib) - {"name", "type", "version"}:
            child = SubElement(element, name)
            child.text = element.get(name)


def _letters(plugin: Element) -> str:
    """Return the letters of a plugin's file name, in lower case."""
    return "".join(letter for letter in (plugin.get("filename") or "").lower() if letter.isalpha())


def pose_of(element: Element) -> Frame:
    """Return an element's <pose> as written, whatever it is relative to; raise ValueError where it is malformed."""
    pose = element.find("pose")
    text = (pose.text or "").strip() if pose is not None else ""
    if not text:
        return Frame.of(0.0, 0.0)
    if pose is not None and pose.get("rotation_format") == "quat_xyzw":
        values = _numbers(text, 7)
        return Frame.from_quaternion(values[:3], values[3:])
    if len(text.split()) == 3:
        return Frame.of(*_numbers(text, 3))
    values = _numbers(text, 6)
    if pose is not None and pose.get("degrees", "").lower() in ("1", "true"):
        values[3:] = np.radians(values[3:])
    return Frame.of(*values)


def _number(element: Element, name: str) -> float:
    return float(_numbers(element.findtext(name), 1)[0])


def _numbers(text: Optional[str], count: int) -> np.ndarray:
    try:
        values = np.array((text or "").split(), dtype=float)
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"'{(text or '').strip()}' must be {count} finite number{'s' if count > 1 else ''}")
    return values
