"""Tasks of episodes: a world, goals in it, and a time limit."""

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
"""Name, in place of a worlds file, of the tutorial's circle in its arena."""

CIRCLE_TIME_LIMIT = 300.0
"""Seconds for one lap, and for a world that states no limit."""

MAP_RESOLUTION = 0.05
"""Default resolution (m) of maps drawn from a world."""

MOST_TOLD = 5
"""Warnings on worlds files that are printed; a mistake in one world is often in all thousand of a file."""


@dataclass(frozen=True)
class EpisodeTask:
    """A drive through a world.

    Attributes:
        name: Name of the task, unique in a batch.
        world: Bodies, movers, and the robot's start.
        goals: Poses to reach, in order, in the world's frame.
        time_limit: Simulated seconds for all of them.
        goal_radius: Distance (m) between true position and goal within which the goal counts as reached, whatever the
            controller's tolerance. It is also the planner's tolerance for a goal that is blocked. None where
            navigation alone decides.
        reference_path_length: Length (m) of a good path, for the score; None where the world states none.
        has_map: Whether a robot usually has a map of the world.
        given_map: Map of the world, which may be wrong; where None, one is drawn from the world's geometry.
        initial_pose: Initial pose of localization; where None, that of amcl's parameters.
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
        """Return the given map, or one drawn from the world's geometry.

        Args:
            resolution: Metres per cell of a drawn map.
            scan_height: Height (m) of the lidar, at which the world is cut for a drawn map.
        """
        if self.given_map is not None:
            return self.given_map
        world = self.world if self.world.goal is not None else replace(self.world, goal=self.goals[-1])
        return map_of_world(world, grid_around(world, resolution, height=scan_height), scan_height)

    def scaled(self, scale: float) -> EpisodeTask:
        """Return the task with all lengths scaled; the time limit grows with them but does not shrink.

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
        """Return the result of an episode that could not be driven; see `result.failed`."""
        return failed(self.name, seed, message, self.reference_path_length)

    def digest(self) -> str:
        """Return a hash over all that defines the task, independent of the file it came from."""
        world = self.world
        parts = [self.name, world.start, self.goals, self.time_limit, self.goal_radius, self.reference_path_length]
        known = hashlib.sha256(repr(parts).encode())
        known.update(world.fixed_triangles()[0].tobytes())
        for body in world.bodies:
            if body.mass:  # movable, hence not among the fixed triangles
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
    """Return the warnings of the worlds' files, the first MOST_TOLD and the number of the others."""
    lines = [line for task in tasks for line in task.world.warnings]
    more = len(lines) - MOST_TOLD
    return lines[:MOST_TOLD] + ([f"and {more} more such lines on the worlds"] if more > 0 else [])


def have_maps(tasks: Sequence[EpisodeTask], is_said: bool) -> bool:
    """Return whether robots usually have maps of these worlds.

    Args:
        tasks: The worlds.
        is_said: Whether the user has chosen (--map), so that mixed worlds are no error.

    Raises:
        ValueError: Some worlds have a map and others have none, and the user has not chosen.
    """
    mapped, bare = ([task for task in tasks if task.has_map is has] for has in (True, False))
    if mapped and bare and not is_said:
        raise ValueError(
            f"world '{mapped[0].name}' has a map of its own, and world '{bare[0].name}' has none; say --map known, "
            "which draws a map where there is none, or --map none"
        )
    return not bare


def task_of(world: World) -> EpisodeTask:
    """Return the task of a world, from its start to its goal.

    Raises:
        ValueError: The world states no goal, or its map cannot be loaded.
    """
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
