"""The abstract planner and the flag by which a running plan is called off."""

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
    """A flag one thread sets and another one's loop reads, compiled loops included.

    Attributes:
        flag: Shape (1,), uint8: 0 until cancelled; kernels read it every few thousand cells.
    """

    def __init__(self) -> None:
        self.flag = np.zeros(1, dtype=np.uint8)

    def cancel(self) -> None:
        """Ask the running plan to stop; it does so within 10 ms."""
        self.flag[0] = 1

    def is_cancelled(self) -> bool:
        """Return whether the plan was called off."""
        return bool(self.flag[0])


class PotentialWatcher(abc.ABC):
    """Somebody who looks at the potential of each plan."""

    @abc.abstractmethod
    def is_watching(self) -> bool:
        """Return whether the potential is wanted at present."""

    @abc.abstractmethod
    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        """Look at a potential: (height, width), 0 where nothing is known. It changes with the next plan."""


@dataclass(frozen=True)
class PotentialDisplay:
    """How a planner's potential is to be published.

    Attributes:
        form: "cloud", points with the potential as navfn publishes them, or "grid", an occupancy grid as
            global_planner does.
        wanted: Whether the user wants it at present.
        highest: Value of the highest potential in a grid, 1 to 127.
    """

    form: str
    wanted: bool
    highest: int = 100


class Planner(Plugin, abc.ABC):
    """Finds a path over a costmap.

    A planner may keep what it learned between calls, to replan faster; the path it returns must be as good as one from
    the arguments alone: what was kept may decide between paths of equal cost, never between others. It is never called
    by two threads at once. Each plan asks it once, with the costmap as it is.

    Attributes:
        potential_watcher: Shown the potential of each plan by planners that have a `potential_display`; None for
            nobody.
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
        """Return a path from `start` to `goal`, both in the costmap's frame, every pose with a heading.

        Args:
            costmap: The snapshot to plan on.
            start: The robot's pose; the path begins there.
            goal: Where to go; the last pose is it, or where it cannot be reached or is no room for the robot, a
                reachable place within `tolerance` of it, one with room where there is such.
            tolerance: Distance (m) by which the goal may be missed; 0 or above.
            cancelled: Stops the search when set.

        Raises:
            PlanningError: OUT_OF_MAP, BLOCKED_START, BLOCKED_GOAL, NO_PATH_FOUND or CANCELED, with a text that says
                what is where.
        """
