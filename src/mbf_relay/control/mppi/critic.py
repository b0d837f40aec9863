"""The abstract critic of sampled trajectories, and what it is shown."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbf_relay.control.mppi.parameters import MppiParameters
from mbf_relay.costmap.footprint_checker import FootprintChecker, FreeWay
from mbf_relay.geometry import Pose2D
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.plugins import Plugin

POINT_SPACING = 0.05
"""Metres between the points of the path that Nav2's `offset_from_furthest` counts: a cell of its usual costmaps."""


@dataclass(frozen=True)
class Rollouts:
    """A batch of B drives of T steps, and what they are judged by; everything in the costmap's frame.

    Attributes:
        parameters: The controller's.
        pose: The robot now.
        goal: The path's end.
        goal_distance: Metres along the path to it.
        velocities: Shape (B, T, 3): body frame, in each step.
        poses: Shape (B, T, 3): after each step.
        way: Up to where each is free.
        checker: The obstacles.
        path: Shape (P, 2), P >= 2: points ahead, POINT_SPACING apart from the one nearest to the robot on.
        path_is_free: Shape (P,), bool: where the robot's centre could be.
        halfway, ends: Shape (B, 2): where each drive is after half its time, and at its end: metres across and along
            the path, from the robot's place on it.
        furthest: Index of the point of the path that is nearest to the end of the drive that gets farthest along it.
    """

    parameters: MppiParameters
    pose: Pose2D
    goal: Pose2D
    goal_distance: float
    velocities: np.ndarray
    poses: np.ndarray
    way: FreeWay
    checker: FootprintChecker
    path: np.ndarray
    path_is_free: np.ndarray
    halfway: np.ndarray
    ends: np.ndarray
    furthest: int

    @cached_property
    def touches(self) -> np.ndarray:
        """Which drives touch something, bool of shape (B,)."""
        return self.checker.meets_something(
            self.poses, np.full(len(self.poses), self.poses.shape[1]), self.way.steps)


@dataclass(frozen=True)
class CriticParameters(ParameterSet):
    """What every critic of MPPI has."""

    enabled: bool = parameter(True, "use this critic")
    cost_weight: float = parameter(1.0, "weight of this critic in the sum of costs", minimum=0.0)
    cost_power: int = parameter(1, "power to which the weighted cost is raised", minimum=1, maximum=10)


class CriticFunction(Plugin, abc.ABC):
    """Tells the cost of each drive by one point of view. Source: Nav2's critic of the same name."""

    Parameters = CriticParameters
    parameters: CriticParameters

    def cost(self, data: Rollouts) -> Any:
        """Return the weighted cost of each drive, shape (B,), or 0 where the critic has nothing to say."""
        p = self.parameters
        if not p.enabled:
            return 0.0
        cost = p.cost_weight * self.score(data)
        return cost if p.cost_power == 1 else cost ** p.cost_power

    @abc.abstractmethod
    def score(self, data: Rollouts) -> Any:
        """Return the cost of each drive before weighting, shape (B,) and 0 or above, or 0 for nothing to say."""
