"""Contacts of the robot with other bodies, by their names."""

from __future__ import annotations

from typing import Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.simulation.physics import ANY, Physics
from mbf_relay.simulation.shapes import bounds

REACH = 0.005
"""Distance (m) from a triangle's bounding box up to which a contact point may belong to it."""
GRAIN, MOST_KNOWN = 0.002, 10000
"""Grid (m) to which points are rounded as keys of the cache of owners, and the size of that cache."""


class Contact(NamedTuple):
    """A contact point between the robot and another body.

    Attributes:
        name: Name of the other body.
        position: Position (m) in the world.
        normal: Unit normal of the other body's surface, towards the robot.
    """

    name: str
    position: Tuple[float, float, float]
    normal: Tuple[float, float, float]


class Contacts:
    """Finds the robot's contacts with anything but the ground."""

    def __init__(self, fixed: List[int], triangles: np.ndarray, owners: np.ndarray, names: List[str]) -> None:
        """Take the fixed surface, which is joined in the physics, to tell which body was touched.

        Args:
            fixed: PyBullet's numbers of the meshes that make up the surface.
            triangles: The surface, shape (N, 3, 3) in metres.
            owners: Index in `names` of each triangle's body, shape (N,).
            names: Names of the bodies.
        """
        self._fixed, self._triangles, self._owners, self._names = fixed, triangles, owners, names
        self._bounds: Optional[Tuple[np.ndarray, np.ndarray]] = None  # most drives touch nothing
        self._known: Dict[Tuple[int, ...], str] = {}

    def find(self, physics: Physics, robot: int, loose: Mapping[int, str]) -> Tuple[Contact, ...]:
        """Return the contacts after the last physics step.

        Args:
            physics: The physics client.
            robot: PyBullet's number of the robot.
            loose: Names of the bodies that are not part of the fixed surface, by number.
        """
        # To ask for the fixed surface alone is faster where that is possible: ANY always returns the ground's points.
        other = self._fixed[0] if len(self._fixed) == 1 and not loose else ANY
        points = physics.contacts(robot, other)
        if not points:
            return ()
        touching = [p for p in points if p[2] != physics.ground and (p[8] <= 0.0 or p[9] > 0.0)]
        if not touching:
            return ()
        return tuple(Contact(loose.get(p[2]) or self.owner_at(p[6]), p[6], p[7]) for p in touching)

    def owner_at(self, position: Tuple[float, float, float]) -> str:
        """Return the name of the fixed body whose surface is nearest to a point (m) on or very near to it."""
        # Cached: a contact often stays in one place, and a search through a building takes as long as ten steps.
        place = tuple(round(coordinate / GRAIN) for coordinate in position)
        if place not in self._known:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[place] = self._find_owner(np.array(position))
        return self._known[place]

    def _find_owner(self, point: np.ndarray) -> str:
        if self._bounds is None:
            self._bounds = bounds(self._triangles)
        lower, upper = self._bounds
        near = np.flatnonzero(((point >= lower - REACH) & (point <= upper + REACH)).all(axis=1))
        if not len(near):
            return "unknown"
        corners = self._triangles[near]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sizes = np.maximum(np.linalg.norm(normals, axis=1), 1e-15)
        distances = np.abs(np.einsum("ij,ij->i", normals, point - corners[:, 0])) / sizes
        return self._names[int(self._owners[near[np.argmin(distances)]])]
