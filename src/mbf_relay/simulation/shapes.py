"""The solids of worlds and robots, and functions on their surfaces as triangles.

Physics, lidar and map drawing all use the triangles of fixed bodies, so that collisions, scans and maps agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Tuple, Union

import numpy as np

from mbf_relay.simulation.frames import Frame

LEVEL = 0.999999
"""Cosine of the largest tilt of a surface that counts as horizontal."""
ROUNDNESS = 2e-4
"""Sagitta (m) of the facets that approximate a round surface; half of it lies inside, half outside."""


@dataclass(frozen=True)
class Box:
    """A box centred in its frame; `size` in metres along x, y, z."""

    size: Tuple[float, float, float]

    def __post_init__(self) -> None:
        _check("box size", self.size)

    def triangles(self) -> np.ndarray:
        """Return the surface, shape (12, 3, 3) in metres, in the shape's own frame."""
        x, y, z = (side / 2.0 for side in self.size)
        return prism_triangles(np.array([[x, y], [-x, y], [-x, -y], [x, -y]]), -z, z)


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder centred in its frame; `radius` and `height` in metres."""

    radius: float
    height: float

    def __post_init__(self) -> None:
        _check("cylinder radius and height", (self.radius, self.height))

    def triangles(self) -> np.ndarray:
        """Return the surface, shape (N, 3, 3) in metres, read-only; see ROUNDNESS."""
        return _cylinder_triangles(self.radius, self.height)


@dataclass(frozen=True)
class Sphere:
    """A sphere centred in its frame; `radius` in metres."""

    radius: float

    def __post_init__(self) -> None:
        _check("sphere radius", (self.radius,))

    def triangles(self) -> np.ndarray:
        """Return the surface, shape (N, 3, 3) in metres, as bands between parallels."""
        sides = _sides(self.radius, 2.0 * ROUNDNESS)
        latitudes = np.linspace(-math.pi / 2.0, math.pi / 2.0, sides // 2 + 1)
        polygons = regular_polygon(1.0, sides)
        rings = [
            np.column_stack((polygons * self.radius * math.cos(a), np.full(sides, self.radius * math.sin(a))))
            for a in latitudes
        ]
        bands = [_band(lower, upper) for lower, upper in zip(rings, rings[1:])]
        triangles = np.concatenate(bands)
        solid: np.ndarray = triangles[_areas(triangles) > 1e-12]
        return solid


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface of triangles, shape (N, 3, 3) in metres, in its own frame."""

    faces: np.ndarray

    def __post_init__(self) -> None:
        faces = np.asarray(self.faces, dtype=float)
        if faces.ndim != 3 or faces.shape[1:] != (3, 3) or not len(faces):
            raise ValueError(f"mesh has faces of shape {faces.shape}; it must be (N, 3, 3) with N above 0")
        if not np.isfinite(faces).all():
            raise ValueError("mesh has corners that are not finite")
        object.__setattr__(self, "faces", faces)

    def triangles(self) -> np.ndarray:
        """Return the surface, shape (N, 3, 3) in metres."""
        return self.faces


Shape = Union[Box, Cylinder, Sphere, Mesh]


@dataclass(frozen=True)
class Body:
    """A named solid in a world.

    Attributes:
        name: Name in contacts and warnings.
        shape: Its geometry.
        frame: Pose of the shape in the world.
        mass: Mass (kg); 0 for a fixed body.
        colour: RGBA for pictures.
    """

    name: str
    shape: Shape
    frame: Frame
    mass: float = 0.0
    colour: Tuple[float, float, float, float] = (0.75, 0.75, 0.72, 1.0)

    def triangles(self) -> np.ndarray:
        """Return the surface in the world, shape (N, 3, 3) in metres."""
        return self.frame.transform_points(self.shape.triangles())

    def scaled(self, scale: float) -> Body:
        """Return the body of a world `scale` times as large; its mass grows with its volume."""
        shape: Shape
        if isinstance(self.shape, Box):
            x, y, z = self.shape.size
            shape = Box((scale * x, scale * y, scale * z))
        elif isinstance(self.shape, Cylinder):
            shape = Cylinder(scale * self.shape.radius, scale * self.shape.height)
        elif isinstance(self.shape, Sphere):
            shape = Sphere(scale * self.shape.radius)
        else:
            shape = Mesh(scale * self.shape.faces)
        frame = Frame(scale * self.frame.position, self.frame.rotation)
        return replace(self, shape=shape, frame=frame, mass=scale ** 3 * self.mass)


def regular_polygon(radius: float, sides: int) -> np.ndarray:
    """Return the corners, shape (sides, 2) in metres, counter-clockwise from the x axis."""
    angles = 2.0 * math.pi * np.arange(sides) / sides
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def prism_triangles(corners: np.ndarray, bottom: float, top: float) -> np.ndarray:
    """Return the surface of a convex polygon's prism, shape (N, 3, 3) in metres.

    Args:
        corners: Shape (C, 2) in metres, counter-clockwise.
        bottom, top: Heights (m) of its two ends.
    """
    count = len(corners)
    lower = np.column_stack((corners, np.full(count, bottom)))
    upper = np.column_stack((corners, np.full(count, top)))
    fan = np.column_stack((np.zeros(count - 2, dtype=int), np.arange(1, count - 1), np.arange(2, count)))
    return np.concatenate((_band(lower, upper), lower[fan[:, ::-1]], upper[fan]))


@lru_cache(maxsize=64)
def _cylinder_triangles(radius: float, height: float) -> np.ndarray:
    """Return a cylinder's surface, cached, as obstacle fields have hundreds of equal ones."""
    sides = _sides(radius)
    corners = regular_polygon(radius / (0.5 + 0.5 * math.cos(math.pi / sides)), sides)
    triangles = prism_triangles(corners, -height / 2.0, height / 2.0)
    triangles.setflags(write=False)
    return triangles


def ring_triangles(inner: np.ndarray, outer: np.ndarray, bottom: float, top: float) -> np.ndarray:
    """Return the surface of a ring-shaped prism, shape (N, 3, 3) in metres.

    Args:
        inner, outer: Polygons with the same number of corners, one inside the other, shape (C, 2) in metres,
            counter-clockwise.
        bottom, top: Heights (m) of the ring's two ends.
    """
    low_in, low_out, high_in, high_out = (
        np.column_stack((corners, np.full(len(corners), height)))
        for height in (bottom, top) for corners in (inner, outer)
    )
    pairs = ((low_out, high_out), (high_out, high_in), (high_in, low_in), (low_in, low_out))
    return np.concatenate([_band(first, second) for first, second in pairs])


def cut(triangles: np.ndarray, height: float) -> Tuple[np.ndarray, np.ndarray]:
    """Cut a surface with a horizontal plane.

    Args:
        triangles: Shape (N, 3, 3) in metres.
        height: Height of the plane (m).

    Returns:
        Segments as x, y (m) of both ends, shape (M, 2, 2), and the index of each segment's triangle, shape (M,).
    """
    above = triangles[:, :, 2] > height
    first, second, third = above.T
    indices = np.flatnonzero((first != second) | (second != third))
    crossing, above = triangles[indices], above[indices]
    # The corner that is alone on its side of the plane; its two edges cross the plane.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    rows = np.arange(len(crossing))
    tip = crossing[rows, alone]
    ends = []
    for step in (1, 2):
        other = crossing[rows, (alone + step) % 3]
        share = (height - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        ends.append(tip[:, :2] + share[:, None] * (other - tip)[:, :2])
    return np.stack(ends, axis=1), indices


def level(triangles: np.ndarray) -> np.ndarray:
    """Return which triangles, shape (N, 3, 3), are horizontal or degenerate, shape (N,) bool."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    flat: np.ndarray = (np.abs(normals[:, 2]) >= LEVEL * sizes) | (sizes <= 1e-15)
    return flat


def bounds(corners: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return the minimum and the maximum of triangles' coordinates over their corners.

    Equal to min and max along axis 1, which take five times as long.

    Args:
        corners: Shape (N, 3) of one coordinate, or (N, 3, D).

    Returns:
        Minimum and maximum, each of shape (N,) or (N, D).
    """
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)


def subdivided(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Bisect triangles, shape (N, 3, 3), at their longest edges until none is longer than `longest` metres.

    A long diagonal wall has a bounding box as large as a room, which would be tested against everything in it.
    """
    lower, upper = bounds(triangles)
    extents = upper - lower
    if (np.einsum("ij,ij->i", extents, extents) < (0.999 * longest) ** 2).all():  # no edge is longer than its box
        return triangles
    done = []
    while len(triangles):
        lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        edge, large = lengths.argmax(axis=1), lengths.max(axis=1) > longest
        done.append(triangles[~large])
        rows = np.arange(len(triangles))[large]
        first, second, third = (triangles[rows, (edge[large] + step) % 3] for step in range(3))
        middle = (first + second) / 2.0
        triangles = np.concatenate(
            (np.stack((first, middle, third), axis=1), np.stack((middle, second, third), axis=1))
        )
    return np.concatenate(done) if done else triangles


def indexed(triangles: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return triangles, shape (N, 3, 3), as an indexed mesh.

    Equal to np.unique with axis=0 and return_inverse, in a fifth of the time.

    Returns:
        Vertices, shape (V, 3) in metres, sorted, and the vertex of each triangle's corners, shape (3 N,).
    """
    points = triangles.reshape(-1, 3)
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    new = np.ones(len(points), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    indices = np.empty(len(points), dtype=np.int64)
    indices[order] = np.cumsum(new) - 1
    return ordered[new], indices


def _band(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return the triangles between two closed polygons of N corners each, shape (2 N, 3, 3)."""
    next_lower, next_upper = np.roll(lower, -1, axis=0), np.roll(upper, -1, axis=0)
    return np.concatenate((
        np.stack((lower, next_lower, next_upper), axis=1), np.stack((lower, next_upper, upper), axis=1),
    ))


def _areas(triangles: np.ndarray) -> np.ndarray:
    edges = triangles[:, 1:] - triangles[:, :1]
    areas: np.ndarray = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return areas


def _sides(radius: float, roundness: float = ROUNDNESS) -> int:
    """Return the number of sides of a polygon that is within `roundness` (m) of a circle; a multiple of four."""
    sagitta = min(0.5, roundness / radius)
    return 4 * max(3, math.ceil(math.pi / math.acos(1.0 - sagitta) / 4.0))


def _check(what: str, values: Tuple[float, ...]) -> None:
    if not all(math.isfinite(value) and value > 0.0 for value in values):
        raise ValueError(f"{what} {tuple(values)} must be finite and above 0 m")
