"""Pictures of a simulation by PyBullet's software renderer, which needs no display.

All bodies are copied to another physics client for it, so that taking a picture does not change the simulation.
"""

from __future__ import annotations

import math
import os
from typing import List, NamedTuple, Tuple

import numpy as np
from PIL import Image

from mbf_relay.simulation.bullet import pybullet
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.physics import CHUNK
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Shape, Sphere
from mbf_relay.simulation.simulation import Simulation

GROUND_COLOUR = (0.55, 0.57, 0.60, 1.0)
DARK, BLACK = (0.20, 0.22, 0.30, 1.0), (0.05, 0.05, 0.05, 1.0)
SIZE = (960, 720)
"""Width and height in pixels."""


class View(NamedTuple):
    """A camera: its position and target (m), the upward direction, and the vertical field of view (rad)."""

    eye: Tuple[float, float, float]
    target: Tuple[float, float, float]
    up: Tuple[float, float, float]
    opening: float


def view_from_above(simulation: Simulation) -> View:
    """Return a view of the whole world from above, x to the right."""
    points = [np.array([[simulation.true_pose.x, simulation.true_pose.y]])]
    points += [body.triangles()[:, :, :2].reshape(-1, 2) for body in simulation.scene.bodies()]
    lower, upper = (f(np.concatenate(points), axis=0) for f in (np.min, np.max))
    x, y = (lower + upper) / 2.0
    opening = math.radians(15.0)
    height = max(upper[1] - lower[1], (upper[0] - lower[0]) * SIZE[1] / SIZE[0], 2.0) * 0.53 / math.tan(opening / 2.0)
    return View((float(x), float(y), float(height)), (float(x), float(y), 0.0), (0.0, 1.0, 0.0), opening)


def view_following(simulation: Simulation) -> View:
    """Return a view from behind and above the robot."""
    pose = simulation.true_pose
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    return View(
        (pose.x - 0.9 * cos, pose.y - 0.9 * sin, 0.75), (pose.x + 0.6 * cos, pose.y + 0.6 * sin, 0.1), (0.0, 0.0, 1.0),
        math.radians(60.0),
    )


def take_pictures(simulation: Simulation, views: List[View]) -> List[np.ndarray]:
    """Return one picture for each view, shape (height, width, 3) uint8."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        _copy(client, simulation)
        return [_render(client, view) for view in views]
    finally:
        pybullet.disconnect(physicsClientId=client)


def save_pictures(simulation: Simulation, folder: str) -> List[str]:
    """Write a view from above and one following the robot as PNG files, and return their paths.

    Raises:
        OSError: A file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    pictures = take_pictures(simulation, [view_from_above(simulation), view_following(simulation)])
    paths = []
    for name, picture in zip(("above", "following"), pictures):
        paths.append(os.path.join(folder, f"{name}_{simulation.now:.2f}.png"))
        Image.fromarray(picture).save(paths[-1])
    return paths


def _render(client: int, view: View) -> np.ndarray:
    width, height = SIZE
    far = 4.0 * math.dist(view.eye, view.target) + 20.0
    _, _, pixels, _, _ = pybullet.getCameraImage(
        width, height, pybullet.computeViewMatrix(view.eye, view.target, view.up),
        pybullet.computeProjectionMatrixFOV(math.degrees(view.opening), width / height, 0.05, far),
        lightDirection=(2.0, -3.0, 8.0), shadow=0, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=client,
    )
    return np.reshape(np.asarray(pixels, dtype=np.uint8), (height, width, 4))[:, :, :3].copy()


def _copy(client: int, simulation: Simulation) -> None:
    """Create visual copies of a simulation's bodies in a client."""
    for body in simulation.scene.bodies():
        _show(client, body)
    pose = simulation.true_pose
    _show(client, Body("ground", Box((60.0, 60.0, 0.01)), Frame.of(pose.x, pose.y, -0.006), colour=GROUND_COLOUR))
    for body in simulation.robot.solids(simulation.base.frame(), {"body": DARK, "wheel": BLACK}):
        _show(client, body)


def _show(client: int, body: Body) -> None:
    position, quaternion = body.frame.position.tolist(), body.frame.quaternion()
    for arguments in _visuals(body.shape):
        shape = pybullet.createVisualShape(rgbaColor=body.colour, physicsClientId=client, **arguments)
        pybullet.createMultiBody(0.0, -1, shape, position, quaternion, physicsClientId=client)


def _visuals(shape: Shape) -> List[dict]:
    """Return arguments of createVisualShape for a shape; a large mesh needs several."""
    if isinstance(shape, Box):
        return [dict(shapeType=pybullet.GEOM_BOX, halfExtents=[side / 2.0 for side in shape.size])]
    if isinstance(shape, Cylinder):
        return [dict(shapeType=pybullet.GEOM_CYLINDER, radius=shape.radius, length=shape.height)]
    if isinstance(shape, Sphere):
        return [dict(shapeType=pybullet.GEOM_SPHERE, radius=shape.radius)]
    triangles, visuals = shape.triangles(), []
    for first in range(0, len(triangles), CHUNK):
        part = triangles[first:first + CHUNK]
        normals = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
        visuals.append(dict(
            shapeType=pybullet.GEOM_MESH, vertices=part.reshape(-1, 3).tolist(), indices=list(range(3 * len(part))),
            normals=np.repeat(normals, 3, axis=0).tolist(),
        ))
    return visuals
