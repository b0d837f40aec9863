"""A wrapper of one PyBullet client: bodies, steps, contacts, rays.

All fixed bodies are joined to one mesh, so that a step costs the same in an empty world and in a building of ten
thousand walls. PyBullet casts rays only at bodies that can move; for fixed ones there is the faster `Surface`.
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

GRAVITY = 9.81
"""Acceleration (m/s^2) of the world's gravity, along -z."""
GROUND, FIXED, ROBOT, LOOSE, ROLLING = 2, 4, 16, 32, 64
"""Collision groups of the ground, fixed bodies, the robot's hull, movable bodies, and the robot's wheels."""

TOUCHING = 2e-5
"""Largest gap (m) of contact points with the ground that the solver uses (contactProcessingThreshold).

Bullet also keeps points of earlier steps, which rise with the turning wheel, and those of the hull, millimetres above
the ground: eight or more where the robot stands on three.
"""

RAYS = 1
"""Bullet's collision group of rays."""
ANY = -1
"""Stands for all bodies in `Physics.contacts`."""
IDENTITY_QUATERNION = (0.0, 0.0, 0.0, 1.0)
CHUNK = 20000
"""Triangles in one mesh; PyBullet's limit is 131072 vertices."""

_hit_fraction = itemgetter(2)
_left: List[int] = []
"""Clients of closed worlds, for reuse: to connect a new one takes 17 ms, where a drive takes 500."""


def _connected() -> int:
    """Return a new client without the software renderer, which would take 4 ms for the texture of each body."""
    client: int = pybullet.connect(pybullet.DIRECT)
    renderer = pybullet.loadPlugin("tinyRendererPlugin", physicsClientId=client)  # loaded already; returns its number
    if renderer >= 0:
        pybullet.unloadPlugin(renderer, physicsClientId=client)
    return client


class Physics:
    """One PyBullet client with a ground plane at z = 0 and gravity."""

    def __init__(self, rate: int, iterations: int, gui: bool = False) -> None:
        """Connect, or take over a client of a closed world.

        Args:
            rate: Steps per second of simulated time.
            iterations: Iterations of the contact solver.
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
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=self.client)
        # With cone friction, which is solved for both directions at once, wheels slip sideways in every turn.
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
        """Set up the window, if there is one: camera at the start, colours."""
        if self.gui:
            window.tidy(self.client, start)
            window.paint(self.client, robot, window.ROBOT)

    def close(self) -> None:
        """Clear the client for reuse, or close its window; may be called more than once."""
        client, self.client = self.client, -1
        if client >= 0 and self.gui:
            pybullet.disconnect(physicsClientId=client)
        elif client >= 0:
            pybullet.resetSimulation(physicsClientId=client)
            _left.append(client)

    def __getstate__(self) -> NoReturn:
        """Raise TypeError: a copy would share the client, which either of the two could change and close."""
        raise TypeError(
            "a simulation cannot be copied or pickled, as its world is PyBullet's; copy before it is built (an "
            "environment: before reset() or after close()), and let each build its own"
        )

    def step(self) -> None:
        """Advance by one period of the rate."""
        pybullet.stepSimulation(physicsClientId=self.client)

    def filter(self, body: int, group: int, mask: int) -> None:
        """Set the collision group of every link of a body, and the groups it collides with (mask)."""
        for link in range(-1, pybullet.getNumJoints(body, physicsClientId=self.client)):
            pybullet.setCollisionFilterGroupMask(body, link, group, mask, physicsClientId=self.client)

    def add_fixed(self, triangles: np.ndarray, group: int, mask: int) -> List[int]:
        """Add a fixed surface, shape (N, 3, 3) in metres; return the numbers of the bodies that make it up."""
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
        """Add a movable body that rays hit: pushed by forces if it has a mass (kg), else moved by `place`."""
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
        """Remove a body."""
        pybullet.removeBody(body, physicsClientId=self.client)

    def place(self, body: int, frame: Frame) -> None:
        """Move a body's centre of mass to a frame, at rest."""
        pybullet.resetBasePositionAndOrientation(
            body, frame.position.tolist(), frame.quaternion(), physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), physicsClientId=self.client)

    def frame_of(self, body: int) -> Frame:
        """Return the frame of a body's centre of mass in the world."""
        position, quaternion = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
        rotation = np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        return Frame(np.array(position), rotation)

    def cast(self, start: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Cast rays from `start`, shape (3,), to `ends`, shape (B, 3), in metres, at movable bodies only.

        Returns:
            Fraction of each ray before its first hit, 1 where it hits nothing, shape (B,).
        """
        starts = np.broadcast_to(start, ends.shape)
        hits = pybullet.rayTestBatch(starts, ends, collisionFilterMask=LOOSE, physicsClientId=self.client)
        return np.fromiter(map(_hit_fraction, hits), dtype=float, count=len(ends))

    def contacts(self, body: int, other: int) -> Sequence[Tuple[Any, ...]]:
        """Return PyBullet's contact points (getContactPoints) of a body with another one, or with all for ANY."""
        points: Sequence[Tuple[Any, ...]] = pybullet.getContactPoints(body, other, physicsClientId=self.client)
        return points
