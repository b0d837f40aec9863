"""The abstract planner, and the flag that cancels a running plan."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.planning.path import Path
from mbf_relay.plugins import Plugin


class Cancellation:
    """A flag that one thread sets and the planner's thread reads, in compiled loops too.

    Attributes:
        flag: Shape (1,), uint8: 0 until cancelled; kernels read it every few thousand cells.
    """

    def __init__(self) -> None:
        self.flag = np.zeros(1, dtype=np.uint8)

    def cancel(self) -> None:
        """Ask the running plan to stop; it does so within 10 ms."""
        self.flag[0] = 1

    def is_cancelled(self) -> bool:
        """Return whether `cancel` was called."""
        return bool(self.flag[0])


class PotentialWatcher(abc.ABC):
    """A receiver of each plan's potential, such as a publisher."""

    @abc.abstractmethod
    def is_watching(self) -> bool:
        """Return whether the potential is wanted at present."""

    @abc.abstractmethod
    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        """Take a plan's potential.

        Args:
            costmap: The snapshot that was planned on.
            potential: Shape (height, width), 0 where unknown; the next plan overwrites it.
            start: Start of the search, in the costmap's frame: the robot's pose, or a free cell near a blocked one.
        """


@dataclass(frozen=True)
class PotentialDisplay:
    """How a planner's potential is to be published.

    Attributes:
        form: "cloud" for a point cloud, as navfn publishes it, or "grid" for an occupancy grid, as global_planner does.
        wanted: Whether the user's parameters ask for it at present.
        highest: Value in a grid that stands for the highest potential, 1 to 127.
    """

    form: str
    wanted: bool
    highest: int = 100


class Planner(Plugin, abc.ABC):
    """Finds a path over a costmap.

    A planner may keep results between calls, to replan faster. They may only decide between paths of equal cost: the
    path must be as good as one planned from the arguments alone. A planner is never called by two threads at once.
    `plan` is called once for each plan, with the present snapshot.

    Attributes:
        potential_watcher: Receives the potential of each plan, from planners that have a `potential_display`; None for
            no receiver.
    """

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.potential_watcher: Optional[PotentialWatcher] = None

    @property
    def potential_display(self) -> Optional[PotentialDisplay]:
        """How the potential is to be published; None for a planner without one."""
        return None

    @abc.abstractmethod
    def plan(
        self, costmap: CostGrid, start: Pose2D, goal: Pose2D, tolerance: float, cancelled: Cancellation
    ) -> Path:
        """Return a path from `start` to `goal`, both in the costmap's frame; every pose has a heading.

        Args:
            costmap: The snapshot to plan on.
            start: The robot's pose, where the path begins.
            goal: The path's last pose. Where it cannot be reached or has no room for the footprint, the path ends at a
                reachable pose within `tolerance` of it, with room if there is such a pose.
            tolerance: Distance (m) by which the goal may be missed, 0 or above.
            cancelled: Stops the search when set.

        Raises:
            PlanningError: OUT_OF_MAP, BLOCKED_START, BLOCKED_GOAL, NO_PATH_FOUND or CANCELED, with a text that gives
                the place and the reason.
        """
