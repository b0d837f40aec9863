"""A controller configured by another local planner's parameters, translated for one of this package."""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, Optional, Tuple, Type

from mbf_relay.control.controller import Controller
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.state import ControlState, GoalTolerance, SpeedLimit
from mbf_relay.geometry import Twist2D
from mbf_relay.planning.path import Path

USUAL_RESOLUTION = 0.05
"""Cell size (m) assumed until the first cycle gives the costmap."""


class TranslatedController(Controller, abc.ABC):
    """Delegates to the controller that `translate` gives. Parameters have a `stuck_timeout`, as that one's."""

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._resolution = USUAL_RESOLUTION
        kind, translated = self._translated(parameters)
        self._driver = kind(name, translated)

    @abc.abstractmethod
    def translate(self, parameters: Any, resolution: float) -> Tuple[Type[PathFollower], Any]:
        """Return the controller's class, which only counts when this is made, and its parameters.

        Args:
            parameters: The present values, by the other planner's names.
            resolution: Cell size (m) of the local costmap.
        """

    def _translated(self, parameters: Any) -> Tuple[Type[PathFollower], Any]:
        """Return what `translate` does, with the `stuck_timeout` that is given by that name."""
        kind, translated = self.translate(parameters, self._resolution)
        return kind, dataclasses.replace(translated, stuck_timeout=parameters.stuck_timeout)

    def reconfigure(self, parameters: Any) -> None:
        """Take new parameters and pass their translation on."""
        super().reconfigure(parameters)
        self._driver.reconfigure(self._translated(parameters)[1])

    @property
    def top_speeds(self) -> Tuple[float, float]:
        """Those of the controller that drives."""
        return self._driver.top_speeds

    @property
    def goal_tolerance(self) -> Optional[GoalTolerance]:
        """That of the controller that drives."""
        return self._driver.goal_tolerance

    def limit_speed(self, limit: SpeedLimit, source: str = "") -> None:
        """Drive no faster than `limit`; see Controller."""
        self._driver.limit_speed(limit, source)

    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path`; see Controller."""
        self._driver.set_path(path, is_new_goal)

    def compute_velocity(self, state: ControlState) -> Twist2D:
        """Return the velocity to command; see Controller."""
        if state.costmap.grid.resolution != self._resolution:
            self._resolution = state.costmap.grid.resolution
            self.reconfigure(self.parameters)
        self._driver.watcher = self.watcher
        return self._driver.compute_velocity(state)

    def is_goal_reached(self, state: ControlState, tolerance: Optional[GoalTolerance] = None) -> bool:
        """Return whether the robot stands at the goal; see Controller."""
        return self._driver.is_goal_reached(state, tolerance)
