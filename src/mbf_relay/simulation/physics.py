"""PyBullet behind a few calls: one world of solids, rays through it, contacts in it.

Everything that never moves is one mesh for the hull to bump into, so that a step costs the same in an empty world and
in a building of ten thousand walls. Rays meet what can move alone; what never moves is seen as a `Surface`.
"""

from __future__ import annotations

from operator import itemgetter
from typing import Any, List, NoReturn, Sequence, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation import window
from mbf_relay.simulation.bullet import pybullet
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.lent import create_mesh
from mbf_relay.simulation.shapes import Box, Cylinder, Shape, Sphere, indexed

GROUND, FIXED, ROBOT, LOOSE, ROLLING = 2, 4, 16, 32, 64
"""Collision groups; Bullet gives rays group 1."""

TOUCHING = 2e-5
"""Gap (m) above the ground up to which a contact point bears anything.

Bullet keeps the points of the last steps, which roll up with a wheel, and those the hull has millimetres above the
ground; it would solve eight contacts or more for the three a robot stands on.
"""

RAYS = 1
ANY = -1
IDENTITY_QUATERNION = (0.0, 0.0, 0.0, 1.0)
CHUNK = 20000
"""Triangles in one mesh; PyBullet takes 131072 corners at a time."""

_hit_fraction = itemgetter(2)
_left: List[int] = []
"""Clients without a window whose worlds are closed: to clear the megabytes of a new one takes 17 ms, a drive 500."""


def _connected() -> int:
    """Return a new client, without the renderer: it fills a texture for each body, in 4 ms, and nobody looks."""
    client: int = pybullet.connect(pybullet.DIRECT)
    renderer = pybullet.loadPlugin("tinyRendererPlugin", physicsClientId=client)  # is there; tells its number
    if renderer >= 0:
        pybullet.unloadPlugin(renderer, physicsClientId=client)
    return client


class Physics:
    """One PyBullet client with a ground plane at z = 0 and gravity."""

    def __init__(self, rate: int, iterations: int, gui: bool = False) -> None:
        """Connect.

        Args:
            rate: Steps per second of simulated time.
            iterations: Of the contact solver.
            gui: Open PyBullet's window.

        Raises:
            OSError: There is no display for the window.
        """
        if gui:
            window.require_display()
        self.gui = gui
        if gui:
            self.client = pybullet.connect(pybullet.GUI)
        else:
            self.client = _left.pop() if _left else _connected()
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self.client)
        # Solved as a cone, for both directions at once, friction lets the wheels creep sideways in every turn.
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / rate, numSolverIterations=iterations, deterministicOverlappingPairs=1,
            enableConeFriction=0, physicsClientId=self.client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self.client)
        self.ground = pybullet.createMultiBody(0.0, plane, physicsClientId=self.client)
        self.filter(self.ground, GROUND, ROBOT | LOOSE | ROLLING)
        pybullet.changeDynamics(
            self.ground, -1, lateralFriction=1.0, contactProcessingThreshold=TOUCHING, physicsClientId=self.client
        )

    def show(self, start: Pose2D, robot: int) -> None:
        """Make the window, if there is one, ready for watching the robot from its start on."""
        if self.gui:
            window.tidy(self.client, start)
            window.paint(self.client, robot, window.ROBOT)

    def close(self) -> None:
        """Empty the client for the next world, or close its window; more than once does no harm."""
        client, self.client = self.client, -1
        if client >= 0 and self.gui:
            pybullet.disconnect(physicsClientId=client)
        elif client >= 0:
            pybullet.resetSimulation(physicsClientId=client)
            _left.append(client)

    def __getstate__(self) -> NoReturn:
        """Raise TypeError: a copy would have no world of its own, but move what is in this one, and close it."""
        raise TypeError(
            "a simulation cannot be copied or pickled, as its world is PyBullet's; copy before it is built (an "
            "environment: before reset() or after close()), and let each build its own"
        )

    def step(self) -> None:
        """Advance by one period of the rate."""
        pybullet.stepSimulation(physicsClientId=self.client)

    def filter(self, body: int, group: int, mask: int) -> None:
        """Put every link of a body in a collision group, and say which groups it meets."""
        for link in range(-1, pybullet.getNumJoints(body, physicsClientId=self.client)):
            pybullet.setCollisionFilterGroupMask(body, link, group, mask, physicsClientId=self.client)

    def add_fixed(self, triangles: np.ndarray, group: int, mask: int) -> List[int]:
        """Add a surface that never moves, shape (N, 3, 3) in metres; return the bodies it takes."""
        bodies = []
        for first in range(0, len(triangles), CHUNK):
            vertices, indices = indexed(triangles[first:first + CHUNK])
            shape = create_mesh(
                pybullet.createCollisionShape, vertices, indices, shapeType=pybullet.GEOM_MESH,
                physicsClientId=self.client,
            )
            body = pybullet.createMultiBody(0.0, shape, physicsClientId=self.client)
            self.filter(body, group, mask)
            if self.gui:
                window.paint(self.client, body, window.WALLS)
            bodies.append(body)
        return bodies

    def add_loose(self, shape: Shape, frame: Frame, mass: float) -> int:
        """Add a solid that is moved, by forces if it has a mass (kg) or by hand; the lidar sees it."""
        body: int = pybullet.createMultiBody(
            mass,
            self.collision_shape(shape),
            -1,
            frame.position.tolist(),
            frame.quaternion(),
            physicsClientId=self.client,
        )
        self.filter(body, LOOSE, RAYS | GROUND | FIXED | ROBOT | LOOSE)
        return body

    def collision_shape(self, shape: Shape) -> int:
        """Return PyBullet's number of a new shape; a mesh becomes its convex hull."""
        if isinstance(shape, Box):
            arguments = dict(shapeType=pybullet.GEOM_BOX, halfExtents=[side / 2.0 for side in shape.size])
        elif isinstance(shape, Cylinder):
            arguments = dict(shapeType=pybullet.GEOM_CYLINDER, radius=shape.radius, height=shape.height)
        elif isinstance(shape, Sphere):
            arguments = dict(shapeType=pybullet.GEOM_SPHERE, radius=shape.radius)
        else:
            corners = np.unique(shape.triangles().reshape(-1, 3), axis=0)
            return create_mesh(
                pybullet.createCollisionShape, corners, shapeType=pybullet.GEOM_MESH, physicsClientId=self.client
            )
        number: int = pybullet.createCollisionShape(physicsClientId=self.client, **arguments)
        return number

    def remove(self, body: int) -> None:
        """Take a body out of the world."""
        pybullet.removeBody(body, physicsClientId=self.client)

    def place(self, body: int, frame: Frame) -> None:
        """Set a body down elsewhere, at rest."""
        pybullet.resetBasePositionAndOrientation(
            body, frame.position.tolist(), frame.quaternion(), physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), physicsClientId=self.client)

    def frame_of(self, body: int) -> Frame:
        """Return where a body's centre of mass is, and how it is turned."""
        position, quaternion = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
        rotation = np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        return Frame(np.array(position), rotation)

    def cast(self, start: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Cast rays from `start`, shape (3,), to `ends`, shape (B, 3), in metres, at loose bodies alone.

        Returns:
            Shape (B,): the share of its way each ray went before it hit something, 1 where it hit nothing.
        """
        starts = np.broadcast_to(start, ends.shape)
        hits = pybullet.rayTestBatch(starts, ends, collisionFilterMask=LOOSE, physicsClientId=self.client)
        return np.fromiter(map(_hit_fraction, hits), dtype=float, count=len(ends))

    def contacts(self, body: int, other: int) -> Sequence[Tuple[Any, ...]]:
        """Return PyBullet's contact points of a body with another one; with all where that is ANY."""
        points: Sequence[Tuple[Any, ...]] = pybullet.getContactPoints(body, other, physicsClientId=self.client)
        return points
