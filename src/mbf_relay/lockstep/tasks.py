"""What an episode is about: a world, where to go in it, and by when."""

from __future__ import annotations

import math

import numpy as np
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.simulation.arena import arena
from mbf_relay.simulation.world import World

CIRCLE = "circle"

CIRCLE_GOALS = tuple(
    Pose2D(x, y, 2.0 * math.atan2(qz, qw))
    for x, y, qz, qw in (
        (-1.75, 0.74, 0.539, 0.843), (-0.36, 1.92, -0.020, 0.999), (0.957, 1.60, -0.163, 0.987),
        (1.8741, 0.3830, -0.70, 0.711), (1.752, -0.928, -0.856, 0.517), (0.418, -2.116, 0.998, 0.0619),
        (-0.775, -1.80, 0.954, 0.300), (-1.990, -0.508, -0.112, 0.999),
    )
)
"""The tutorial's circle."""

CIRCLE_TIME_LIMIT = 300.0


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

    def occupancy(self) -> OccupancyMap:
        """Return the map of the world as a map server would give it."""
        return rough_map(self.world)


def circle(laps: int = 1) -> Task:
    """Return the tutorial's circle in its arena."""
    return Task(CIRCLE, arena(), CIRCLE_GOALS * laps, CIRCLE_TIME_LIMIT * laps, has_map=True)


def load_tasks(source: str) -> List[Task]:
    """Return the tasks of a worlds file, or the circle.

    Args:
        source: "circle", or the path of a worlds file.

    Raises:
        ValueError: The file is missing, malformed, or a world in it states no goal; the text says which.
    """
    if source == CIRCLE:
        return [circle()]
    from mbf_relay.simulation.worlds_file import load_worlds_file

    return [task_of(world) for world in load_worlds_file(Path(source))]


def task_of(world: World) -> Task:
    """Return the task a world states: from its start to its goal."""
    if world.goal is None:
        raise ValueError(f"world '{world.name}' states no goal; give it one as [x, y, yaw]")
    limit = world.time_limit if world.time_limit is not None else CIRCLE_TIME_LIMIT
    return Task(world.name, world, (world.goal,), limit, world.goal_radius, world.reference_path_length, initial_pose=world.start)


def rough_map(world: World, resolution: float = 0.05) -> OccupancyMap:
    """Return the outlines of a world as a map whose other cells are free."""
    segments = world.outline(0.182)
    low, high = segments.min(axis=(0, 1)) - 0.5, segments.max(axis=(0, 1)) + 0.5
    width, height = (int(n) for n in np.ceil((high - low) / resolution))
    data = np.zeros((height, width), dtype=np.int8)
    for share in np.linspace(0.0, 1.0, 200):
        cells = np.floor((segments[:, 0] + share * (segments[:, 1] - segments[:, 0]) - low) / resolution).astype(int)
        data[cells[:, 1], cells[:, 0]] = 100
    return OccupancyMap(data, resolution, Pose2D(float(low[0]), float(low[1]), 0.0))
