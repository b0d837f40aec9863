"""The contents of a robot's URDF: poses of links with every joint at zero, solids, masses, joints, Gazebo's plugins."""

from __future__ import annotations

from typing import Container, Dict, Iterator, List, NamedTuple, Optional, Tuple
from xml.etree.ElementTree import Element

import numpy as np

from mbf_relay.simulation.robot import BASE_FRAME, FOOTPRINT_FRAME
from mbf_relay.simulation.urdf import link_frames, numbers_of, origin_of, shape_of


class Solid(NamedTuple):
    """A collision geometry: its link, and its corners, shape (N, 3) in metres, in the base."""

    link: str
    corners: np.ndarray

    @property
    def low(self) -> float:
        """Height (m) of its lowest corner."""
        return float(self.corners[:, 2].min())

    @property
    def middle(self) -> np.ndarray:
        """Centre of its bounding box, shape (3,) in metres."""
        middle: np.ndarray = 0.5 * (self.corners.min(axis=0) + self.corners.max(axis=0))
        return middle


class Description:
    """A URDF, with every joint at zero.

    Attributes:
        root: The root element.
        first: The root link.
        base: The link in which poses are given and whose x axis points forward: robotBaseFrame of a Gazebo plugin, else
            base_footprint, else base_link, else the root link.
        places: Poses of the links in the base.
        solids: Collision geometries of all links, in the file's order; visual ones of a link that has no other.
        masses: Masses (kg) of the links that have one.
        joints: Elements of the joints, by child link.
        words: All texts in Gazebo's plugins, among them the joints that they drive.
        plugins: File names of Gazebo's plugins, separated by spaces.
        warnings: What is not simulated as described.
    """

    def __init__(self, robot: Element, folder: str) -> None:
        """Read a URDF's root element; `folder` is that of the file.

        Raises:
            ValueError: It is malformed, or a mesh is missing.
        """
        if robot.tag != "robot":
            raise ValueError(f"it begins with <{robot.tag}>, and a URDF with <robot>")
        self.root = robot
        self.warnings: List[str] = []
        frames = link_frames(robot)
        self.joints: Dict[str, Element] = {}
        for joint in robot.findall("joint"):
            child = joint.find("child")
            self.joints["" if child is None else child.get("link", "")] = joint
        roots = [name for name in frames if name not in self.joints]
        if not roots:
            raise ValueError("it has no link")
        self.first = roots[0]
        plugins = [plugin for plugin in robot.iter("plugin") if plugin.get("filename")]
        said = [plugin.findtext("robotBaseFrame", "").strip() for plugin in plugins]
        self.base = next(name for name in (*said, FOOTPRINT_FRAME, BASE_FRAME, self.first) if name in frames)
        inverse = frames[self.base].inverse()
        self.places = {name: inverse.compose(frame) for name, frame in frames.items()}
        self.plugins = " ".join(plugin.get("filename", "") for plugin in plugins)
        self.words = {(part.text or "").strip() for plugin in plugins for part in plugin.iter()}
        self.masses = {
            link.get("name", "link"): float(numbers_of(mass, "value", 1)[0])
            for link in robot.findall("link") for mass in link.iterfind("inertial/mass")}
        self.solids = [solid for link in robot.findall("link") for solid in self._solids(link, folder)]

    def movable(self, but: Container[str]) -> Tuple[str, ...]:
        """Return the names of all movable joints, without mimic joints and those in `but`."""
        names = [
            joint.get("name", "") for joint in self.joints.values()
            if joint.get("type") in ("continuous", "revolute", "prismatic") and joint.find("mimic") is None]
        return tuple(name for name in names if name not in but)

    def axis(self, link: str) -> np.ndarray:
        """Return the axis of a link's joint as a unit vector in the base, shape (3,)."""
        element = self.joints[link].find("axis")
        axis = np.array([1.0, 0.0, 0.0]) if element is None else numbers_of(element, "xyz", 3, "1 0 0")
        turned: np.ndarray = self.places[link].rotation @ (axis / max(float(np.linalg.norm(axis)), 1e-9))
        return turned

    def limit(self, link: str, name: str) -> float:
        """Return a limit of a link's joint, by its attribute's name; 0 where it has none."""
        element = self.joints[link].find("limit")
        return 0.0 if element is None else float(numbers_of(element, name, 1, "0")[0])

    def parent(self, link: str) -> str:
        """Return a link's parent; empty for the root."""
        element = self.joints[link].find("parent") if link in self.joints else None
        return "" if element is None else element.get("link", "")

    def _solids(self, link: Element, folder: str) -> Iterator[Solid]:
        name = link.get("name", "link")
        for element in link.findall("collision") or link.findall("visual"):
            if _is_point(element.find("geometry")):
                continue
            try:
                shape = shape_of(element.find("geometry"), folder)
            except (ValueError, OSError) as error:  # an error, as the robot would be smaller without it
                raise ValueError(f"link '{name}': {error}") from error
            if shape is None:
                raise ValueError(f"link '{name}': a <{element.tag}> has a geometry that is not understood")
            place = self.places[name].compose(origin_of(element))
            yield Solid(name, place.transform_points(shape.triangles().reshape(-1, 3)))


def _is_point(geometry: Optional[Element]) -> bool:
    """Return whether a geometry has a dimension of zero, as dummy links often have."""
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        return False
    words = [word for name in ("size", "radius", "length") for word in shape.get(name, "").split()]
    return any(word.strip("0.") == "" for word in words)
