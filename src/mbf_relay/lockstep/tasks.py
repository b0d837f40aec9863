"""What an episode is about: a world, where to go in it, and by when."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.result import EpisodeResult, failed
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.maps import OccupancyMap, load_map
from mbf_relay.simulation import arena
from mbf_relay.simulation.world import World, scaled_pose
from mbf_relay.simulation.world_map import SCAN_HEIGHT, grid_around, map_of_world
from mbf_relay.simulation.worlds_file import load_worlds_file

CIRCLE = "circle"
"""Where a worlds file is asked for, this means the tutorial's circle in its arena."""

CIRCLE_TIME_LIMIT = 300.0
"""Seconds for one lap, and for a world that states no limit."""

MAP_RESOLUTION = 0.05
"""Metres per cell of maps drawn from a world, where nothing else is asked for."""

MOST_TOLD = 5
"""Lines on slips in worlds files that are told one by one: one in a world is often one in all of a thousand."""


@dataclass(frozen=True)
class EpisodeTask:
    """Drive through a world.

    Attributes:
        name: Tells the tasks of a batch apart.
        world: What stands and moves, and where the robot starts.
        goals: Poses to reach, in order, in the world's frame.
        time_limit: Seconds for all of them.
        goal_radius: A goal counts as reached within this distance (m) of its position, whatever the controller's
            tolerance, and where something stands on it, the place nearest to it within will do; None where navigation
            alone judges.
        reference_path_length: Length (m) of a good way, for the score; None where the world states none.
        has_map: Whether a robot usually has a map of it.
        given_map: Its map, right or wrong; where None, one is drawn from the world's geometry.
        initial_pose: Where localization is told it starts; what amcl's parameters say where None.
    """

    name: str
    world: World
    goals: Tuple[Pose2D, ...]
    time_limit: float
    goal_radius: Optional[float] = None
    reference_path_length: Optional[float] = None
    has_map: bool = False
    initial_pose: Optional[Pose2D] = None
    given_map: Optional[OccupancyMap] = None

    def occupancy(self, resolution: float = MAP_RESOLUTION, scan_height: float = SCAN_HEIGHT) -> OccupancyMap:
        """Return the map of the world as a map server would give it; drawn at the lidar's height (m) where none is."""
        if self.given_map is not None:
            return self.given_map
        world = self.world if self.world.goal is not None else replace(self.world, goal=self.goals[-1])
        return map_of_world(world, grid_around(world, resolution, height=scan_height), scan_height)

    def scaled(self, scale: float) -> EpisodeTask:
        """Return the task in a world `scale` times as large; the time limit grows with the way.

        Raises:
            ValueError: The scale is out of range, or the task has a map of its own, whose cells do not scale.
        """
        if scale == 1.0:
            return self
        if self.given_map is not None:
            raise ValueError(f"world '{self.name}' has a map of its own; it cannot be made {scale:g} times as large")
        return replace(
            self, world=self.world.scaled(scale), goals=tuple(scaled_pose(goal, scale) for goal in self.goals),
            time_limit=self.time_limit * max(1.0, scale),
            goal_radius=None if self.goal_radius is None else scale * self.goal_radius,
            reference_path_length=None if self.reference_path_length is None else scale * self.reference_path_length,
            initial_pose=None if self.initial_pose is None else scaled_pose(self.initial_pose, scale),
        )

    def failed(self, seed: int, message: str) -> EpisodeResult:
        """Return the result of an episode that could not be driven; it scores 0 where the world has scores."""
        return failed(self.name, seed, message, self.reference_path_length)

    def digest(self) -> str:
        """Return a hash over everything that tells this task from another one, whatever folder it came from."""
        world = self.world
        parts = [self.name, world.start, self.goals, self.time_limit, self.goal_radius, self.reference_path_length]
        known = hashlib.sha256(repr(parts).encode())
        known.update(world.fixed_triangles()[0].tobytes())
        for body in world.bodies:
            if body.mass:  # it is pushed, and not among what never moves
                known.update(body.triangles().tobytes() + repr(body.mass).encode())
        if self.given_map is not None:
            given = self.given_map
            known.update(given.data.tobytes() + repr((given.resolution, given.origin)).encode())
        for mover in world.movers:
            known.update(mover.times.tobytes() + mover.poses.tobytes() + mover.body.triangles().tobytes())
            known.update(b"loops" if mover.loop else b"")
        return known.hexdigest()


def circle(laps: int = 1) -> EpisodeTask:
    """Return the tutorial's circle in its arena."""
    goals = tuple(Pose2D(x, y, 2.0 * math.atan2(qz, qw)) for x, y, qz, qw in arena.CIRCLE)
    given = load_map(str(config_folder() / "maps" / "turtlebot3_world.yaml"))
    return EpisodeTask(CIRCLE, arena.arena(), goals * laps, CIRCLE_TIME_LIMIT * laps, has_map=True, given_map=given)


def load_tasks(source: str) -> List[EpisodeTask]:
    """Return the tasks of a worlds file, or the circle.

    Args:
        source: "circle", or the path of a worlds file.

    Raises:
        ValueError: The file is missing, malformed, or a world in it states no goal; the text says which.
    """
    if source == CIRCLE:
        return [circle()]
    return [task_of(world) for world in load_worlds_file(Path(source))]


def warnings_of(tasks: Sequence[EpisodeTask]) -> List[str]:
    """Return what of the worlds' files is not understood or hardly meant, and how many lines more there are of it."""
    lines = [line for task in tasks for line in task.world.warnings]
    more = len(lines) - MOST_TOLD
    return lines[:MOST_TOLD] + ([f"and {more} more such lines on the worlds"] if more > 0 else [])


def have_maps(tasks: Sequence[EpisodeTask], is_said: bool) -> bool:
    """Return whether robots usually have maps of these worlds.

    Args:
        tasks: The worlds.
        is_said: Whether somebody says what they have, whatever is usual.

    Raises:
        ValueError: Some worlds have a map of their own and some have none, and nobody says what is to be.
    """
    mapped, bare = ([task for task in tasks if task.has_map is has] for has in (True, False))
    if mapped and bare and not is_said:
        raise ValueError(
            f"world '{mapped[0].name}' has a map of its own, and world '{bare[0].name}' has none; say --map known, "
            "which draws a map where there is none, or --map none"
        )
    return not bare


def task_of(world: World) -> EpisodeTask:
    """Return the task a world states: from its start to its goal."""
    if world.goal is None:
        raise ValueError(f"world '{world.name}' states no goal; give it one as [x, y, yaw]")
    limit = world.time_limit if world.time_limit is not None else CIRCLE_TIME_LIMIT
    try:
        given = load_map(world.map_file) if world.map_file is not None else None
    except (OSError, ValueError) as error:
        raise ValueError(f"the map of world '{world.name}': {error}") from error
    return EpisodeTask(
        world.name,
        world,
        (world.goal,),
        limit,
        world.goal_radius,
        world.reference_path_length,
        has_map=given is not None,
        initial_pose=world.start,
        given_map=given,
    )
