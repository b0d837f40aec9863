"""All bodies in the physics but the robot: the fixed surface, loose bodies, movers, and obstacles added at run time."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, Hashable, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation import clearance
from mbf_relay.simulation.contacts import Contact, Contacts
from mbf_relay.simulation.physics import FIXED, LOOSE, ROBOT, Physics
from mbf_relay.simulation.robot import ROLLED_OVER, RobotModel
from mbf_relay.simulation.shapes import Body, Mesh, bounds, level, subdivided
from mbf_relay.simulation.surface import Surface
from mbf_relay.simulation.world import Mover, World

MOST_TRIANGLES = 2000000
"""Largest number of triangles of the fixed surface, lest it fill the memory."""
LONGEST_EDGE = 0.8
"""Longest edge (m) of a triangle in the collision mesh; see `subdivided`."""
REACHED, SWAY = 1.0, 0.1
"""Height (m) up to which loose bodies collide with the fixed surface, and the same for the robot, above its top."""
SEEN_BAND = 0.5
"""Distance (m) above and below the lidar within which beams can hit a surface when the robot tilts a little."""


class Scene:
    """The bodies of a world in one physics client."""

    def __init__(self, physics: Physics, world: World, robot: RobotModel) -> None:
        """Build the world.

        Args:
            physics: The physics client.
            world: The world.
            robot: The robot, for its lidar's height and its outline.

        Raises:
            ValueError: The world has more than MOST_TRIANGLES.
        """
        self._physics, self._world, self._robot = physics, world, robot
        triangles, owners = _higher(ROLLED_OVER, *world.fixed_triangles())
        if len(triangles) > MOST_TRIANGLES:
            raise ValueError(
                f"world '{world.name}' has {len(triangles)} triangles; at most {MOST_TRIANGLES} are possible"
            )
        reached = max(robot.height + SWAY, REACHED if any(body.mass > 0.0 for body in world.bodies) else 0.0)
        fixed = physics.add_fixed(subdivided(low_enough(triangles, reached), LONGEST_EDGE), FIXED, ROBOT | LOOSE)
        self._seen = Surface(seen_by_level_rays(triangles, robot.scan_height))
        self._triangles, self._owners = triangles, owners
        self._halls = [index for index, body in enumerate(world.bodies) if isinstance(body.shape, Mesh)]
        self._contacts = Contacts(fixed, triangles, owners, [body.name for body in world.bodies])
        self._loose = [(physics.add_loose(b.shape, b.frame, b.mass), b) for b in world.bodies if b.mass > 0.0]
        self._movers: List[Tuple[int, Mover]] = [
            (physics.add_loose(mover.body.shape, mover.frame_at(0.0), 0.0), mover) for mover in world.movers
        ]
        self._obstacles: Dict[Hashable, Tuple[int, Body]] = {}
        self._names = {number: body.name for number, body in self._loose}
        self._names.update({number: mover.body.name for number, mover in self._movers})

    @property
    def restless(self) -> bool:
        """Whether there are loose bodies, movers or obstacles, which may push the robot."""
        return bool(self._names)

    @property
    def obstacles(self) -> Mapping[Hashable, Body]:
        """The obstacles added at run time, by their key."""
        return {key: body for key, (_, body) in self._obstacles.items()}

    def set_obstacle(self, key: Hashable, body: Body) -> None:
        """Add an obstacle, or replace or move the one of that key."""
        known = self._obstacles.get(key)
        if known is not None and known[1].shape == body.shape:
            number = known[0]
            self._physics.place(number, body.frame)
        else:
            self.remove_obstacle(key)
            number = self._physics.add_loose(body.shape, body.frame, 0.0)
        self._obstacles[key] = (number, body)
        self._names[number] = body.name

    def remove_obstacle(self, key: Hashable) -> bool:
        """Remove an obstacle; return whether there was one of that key."""
        known = self._obstacles.pop(key, None)
        if known is None:
            return False
        self._physics.remove(known[0])
        del self._names[known[0]]
        return True

    def advance(self, elapsed: float) -> None:
        """Move the movers to their poses `elapsed` seconds after the start."""
        for number, mover in self._movers:
            self._physics.place(number, mover.frame_at(elapsed))

    def reset(self) -> None:
        """Remove the obstacles and move everything else back to its initial pose."""
        for key in list(self._obstacles):
            self.remove_obstacle(key)
        for number, body in self._loose:
            self._physics.place(number, body.frame)
        self.advance(0.0)

    def contacts_of(self, robot: int) -> Tuple[Contact, ...]:
        """Return the contacts of the robot, given by its number in the physics, after the last step."""
        return self._contacts.find(self._physics, robot, self._names)

    def cast(self, start: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Cast rays from `start`, shape (3,), to `ends`, shape (B, 3), in metres; robot and ground are never hit.

        Returns:
            Fraction of each ray before its first hit, 1 where it hits nothing, shape (B,).
        """
        shares = self._seen.cast(start, ends)
        return np.minimum(shares, self._physics.cast(start, ends)) if self._names else shares

    def obstruction_at(self, pose: Pose2D) -> Optional[str]:
        """Return the name of a body that the robot would intersect at `pose`, None where there is room."""
        owner = clearance.obstruction(self._triangles, self._owners, pose, self._robot, self._halls)
        if owner is not None:
            return self._world.bodies[owner].name
        blocking = (body.name for body in self._moved_bodies() if self.obstructs(body, pose))
        return next(blocking, None)

    def obstructs(self, body: Body, pose: Pose2D) -> bool:
        """Return whether the robot would intersect a body at `pose`."""
        return clearance.surface_obstructs(body.triangles(), pose, self._robot)

    def bodies(self) -> List[Body]:
        """Return all bodies with their current frames."""
        return [body for body in self._world.bodies if body.mass == 0.0] + list(self._moved_bodies())

    def _moved_bodies(self) -> Iterator[Body]:
        """Yield loose bodies, movers and obstacles with their current frames."""
        for number, body in self._loose + [(n, m.body) for n, m in self._movers] + list(self._obstacles.values()):
            yield replace(body, frame=self._physics.frame_of(number))


def low_enough(triangles: np.ndarray, reached: float) -> np.ndarray:
    """Return the triangles, shape (N, 3, 3), that have a part between the ground and a height (m)."""
    lowest, highest = bounds(triangles[:, :, 2])
    low: np.ndarray = triangles[(lowest < reached) & (highest > 0.0)]
    return low


def seen_by_level_rays(triangles: np.ndarray, height: float) -> np.ndarray:
    """Return the triangles, shape (N, 3, 3), that a lidar at `height` (m) can see: not horizontal, within SEEN_BAND."""
    lowest, highest = bounds(triangles[:, :, 2])
    triangles = triangles[(lowest < height + SEEN_BAND) & (highest > height - SEEN_BAND)]
    seen: np.ndarray = triangles[~level(triangles)]
    return seen


def _higher(height: float, triangles: np.ndarray, owners: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return the triangles that reach above `height` (m), and their owners."""
    higher = bounds(triangles[:, :, 2])[1] > height
    return (triangles, owners) if higher.all() else (triangles[higher], owners[higher])
