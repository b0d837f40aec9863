"""What an episode is about: a world, where to go in it, and by when."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.maps import OccupancyMap, load_map
from mbf_relay.simulation import arena
from mbf_relay.simulation.world import World
from mbf_relay.simulation.world_map import grid_around, map_of_world
from mbf_relay.simulation.worlds_file import load_worlds_file

CIRCLE = "circle"
"""Where a worlds file is asked for, this means the tutorial's circle in its arena."""

CIRCLE_TIME_LIMIT = 300.0
"""Seconds for one lap, and for a world that states no limit."""

MAP_RESOLUTION = 0.05
"""Metres per cell of maps drawn from a world."""


@dataclass(frozen=True)
class Task:
    """Drive through a world.

    Attributes:
        name: Tells the tasks of a batch apart.
        world: What stands and moves, and where the robot starts.
        goals: Poses to reach, in order, in the world's frame.
        time_limit: Seconds for all of them.
        goal_radius: A goal counts as reached within this distance (m) of its position, whatever the controller's
            tolerance; None where navigation alone judges.
        reference_path_length: Length (m) of a good way, for the score; None where the world states none.
        has_map: Whether a robot usually has a map of it.
        map_file: YAML file of its map; where None, the map is drawn from the world's geometry.
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
    map_file: Optional[Path] = None

    def occupancy(self) -> OccupancyMap:
        """Return the map of the world as a map server would give it."""
        if self.map_file is not None:
            return load_map(str(self.map_file))
        return map_of_world(self.world, grid_around(self.world, MAP_RESOLUTION))

    def digest(self) -> str:
        """Return a hash over everything that tells this task from another one, whatever folder it came from."""
        world = self.world
        parts = [self.name, world.start, self.goals, self.time_limit, self.goal_radius, self.reference_path_length]
        known = hashlib.sha256(repr(parts).encode())
        known.update(world.fixed_triangles()[0].tobytes())
        for mover in world.movers:
            known.update(mover.times.tobytes() + mover.poses.tobytes() + mover.body.triangles().tobytes())
        return known.hexdigest()


def circle(laps: int = 1) -> Task:
    """Return the tutorial's circle in its arena."""
    goals = tuple(Pose2D(x, y, 2.0 * math.atan2(qz, qw)) for x, y, qz, qw in arena.CIRCLE)
    map_file = config_folder() / "maps" / "turtlebot3_world.yaml"
    return Task(CIRCLE, arena.arena(), goals * laps, CIRCLE_TIME_LIMIT * laps, has_map=True, map_file=map_file)


def load_tasks(source: str) -> List[Task]:
    """Return the tasks of a worlds file, or the circle.

    Args:
        source: "circle", or the path of a worlds file.

    Raises:
        ValueError: The file is missing, malformed, or a world in it states no goal; the text says which.
    """
    if source == CIRCLE:
        return [circle()]
    return [task_of(world) for world in load_worlds_file(Path(source))]


def task_of(world: World) -> Task:
    """Return the task a world states: from its start to its goal."""
    if world.goal is None:
        raise ValueError(f"world '{world.name}' states no goal; give it one as [x, y, yaw]")
    limit = world.time_limit if world.time_limit is not None else CIRCLE_TIME_LIMIT
    return Task(world.name, world, (world.goal,), limit, world.goal_radius, world.reference_path_length, initial_pose=world.start)
