"""Reads the triangles of mesh files: STL, Wavefront OBJ and COLLADA."""

from __future__ import annotations

import io
import os
import struct
from typing import Callable, Dict, List, Optional
from xml.etree.ElementTree import Element

import numpy as np

from mbf_relay import files
from mbf_relay.simulation.frames import Frame

LARGEST_MESH = 512 << 20
"""Largest size (bytes) of a mesh file."""
MOST_TRIANGLES, MOST_PARTS = 5000000, 10000
"""Limits for a COLLADA scene, whose nodes can instantiate others: a short file may expand to any size."""


def read_mesh(path: str) -> np.ndarray:
    """Return the triangles of a mesh file, shape (N, 3, 3) in metres.

    Raises:
        ValueError: The file is malformed, empty, or of an unknown format; the text names it.
        OSError: It cannot be opened.
    """
    reader = READERS.get(os.path.splitext(path)[1].lower())
    if reader is None:
        raise ValueError(f"mesh {path} cannot be read: only {', '.join(sorted(READERS))} are understood")
    try:
        triangles = reader(path)
    except (
        ValueError,
        LookupError,
        AttributeError,
        TypeError,
        ArithmeticError,
        struct.error,
        RecursionError,
        StopIteration,
    ) as error:
        raise ValueError(f"mesh {path} is malformed: {error}") from error
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ValueError(f"mesh {path} has no triangles, or corners that are not finite")
    return triangles


def _read_stl(path: str) -> np.ndarray:
    with files.open_regular(path, LARGEST_MESH) as file:
        content = file.read()
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        return np.frombuffer(content, record, count, 84)["corners"].astype(float)
    words = [
        line.split()[1:4] for line in content.decode("utf-8", "replace").splitlines() if line.split()[:1] == ["vertex"]
    ]
    return np.array(words, dtype=float).reshape(-1, 3, 3)


def _read_obj(path: str) -> np.ndarray:
    corners: List[List[float]] = []
    faces: List[List[int]] = []
    with io.TextIOWrapper(files.open_regular(path, LARGEST_MESH), encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                corners.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                polygon = [int(word.split("/")[0]) for word in words[1:]]
                polygon = [index - 1 if index > 0 else len(corners) + index for index in polygon]
                faces.extend([polygon[0], b, c] for b, c in zip(polygon[1:], polygon[2:]))
    triangles: np.ndarray = np.array(corners, dtype=float).reshape(-1, 3)[np.array(faces, dtype=int).reshape(-1, 3)]
    return triangles


def _read_collada(path: str) -> np.ndarray:
    """Return the triangles of the visual scene of a COLLADA file, in metres; up_axis is ignored, as by Gazebo."""
    root = files.read_xml(path)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    geometries = {g.get("id"): _collada_geometry(g) for g in root.iter("geometry")}
    nodes = {node.get("id"): node for node in root.iter("node") if node.get("id")}
    found: List[np.ndarray] = []
    with np.errstate(invalid="ignore"):  # some files have a camera at infinity; triangles are checked by read_mesh
        for node in root.iterfind(".//visual_scene/node"):
            _collada_node(node, np.eye(4), geometries, nodes, found)
    if not found:
        found = list(geometries.values())
    triangles: np.ndarray = np.concatenate(found)
    unit = root.find("asset/unit")
    if unit is not None:
        triangles = triangles * float(unit.get("meter", "1"))
    return triangles


def _collada_node(
    node: Element, parent: np.ndarray, geometries: Dict[Optional[str], np.ndarray],
    nodes: Dict[Optional[str], Element], found: List[np.ndarray],
) -> None:
    """Append the triangles of a node and its children, in the scene's frame, to `found`."""
    transform = parent
    for element in node:
        if element.tag == "instance_geometry":
            triangles = geometries[element.get("url", "").lstrip("#")]
            if len(triangles) + sum(map(len, found)) > MOST_TRIANGLES or len(found) > MOST_PARTS:
                raise ValueError(f"it has more than {MOST_TRIANGLES} triangles or {MOST_PARTS} parts")
            found.append(triangles @ transform[:3, :3].T + transform[:3, 3])
        elif element.tag == "instance_node":
            _collada_node(nodes[element.get("url", "").lstrip("#")], transform, geometries, nodes, found)
        elif element.tag == "node":
            _collada_node(element, transform, geometries, nodes, found)
        elif element.tag in ("matrix", "translate", "rotate", "scale"):
            transform = transform @ _collada_transform(element)


def _collada_transform(element: Element) -> np.ndarray:
    values = np.array((element.text or "").split(), dtype=float)
    transform = np.eye(4)
    if element.tag == "matrix":
        transform = values.reshape(4, 4)
    elif element.tag == "translate":
        transform[:3, 3] = values
    elif element.tag == "scale":
        transform[:3, :3] = np.diag(values)
    else:
        half = np.radians(values[3]) / 2.0
        axis = values[:3] / (np.linalg.norm(values[:3]) or 1.0)  # an axis of zeros is no rotation
        transform[:3, :3] = Frame.from_quaternion((0.0, 0.0, 0.0), (*np.sin(half) * axis, np.cos(half))).rotation
    return transform


def _collada_geometry(geometry: Element) -> np.ndarray:
    """Return the triangles of a geometry, shape (N, 3, 3), in its own units."""
    mesh = geometry.find("mesh")
    if mesh is None:
        return np.empty((0, 3, 3))
    arrays = {
        source.get("id"): np.array((source.findtext("float_array") or "").split(), dtype=float)
        for source in mesh.findall("source")
    }
    positions = {
        vertices.get("id"): arrays[_source_of(vertices)].reshape(-1, 3)
        for vertices in mesh.findall("vertices")
    }
    parts = [
        _collada_faces(group, positions)
        for kind in ("triangles", "polylist", "polygons")
        for group in mesh.findall(kind)
    ]
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))


def _source_of(vertices: Element) -> str:
    positions = vertices.find("input[@semantic='POSITION']")
    if positions is None:
        raise ValueError("a mesh has vertices without positions")
    return positions.get("source", "").lstrip("#")


def _collada_faces(group: Element, positions: Dict[Optional[str], np.ndarray]) -> np.ndarray:
    """Return the triangles of one group of faces; polygons are assumed to be convex."""
    inputs = group.findall("input")
    vertex = next(i for i in inputs if i.get("semantic") == "VERTEX")
    corners = positions[vertex.get("source", "").lstrip("#")]
    stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
    offset = int(vertex.get("offset", "0"))
    lists = [np.array((p.text or "").split(), dtype=int)[offset::stride] for p in group.findall("p")]
    if group.tag == "triangles":
        return corners[np.concatenate(lists).reshape(-1, 3)] if lists else np.empty((0, 3, 3))
    if group.tag == "polylist":
        counts = np.array((group.findtext("vcount") or "").split(), dtype=int)
        lists = np.split(np.concatenate(lists), np.cumsum(counts)[:-1])
    fans = [[polygon[0], b, c] for polygon in lists for b, c in zip(polygon[1:], polygon[2:])]
    triangles: np.ndarray = corners[np.array(fans, dtype=int).reshape(-1, 3)]
    return triangles


READERS: Dict[str, Callable[[str], np.ndarray]] = {".stl": _read_stl, ".obj": _read_obj, ".dae": _read_collada}
