"""The abstract critic of MPPI, and the data it scores by."""

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
    """A batch of B sampled trajectories of T steps, and the data for critics; everything in the costmap's frame.

    Attributes:
        parameters: The controller's.
        pose: The robot's present pose.
        goal: The goal's pose.
        goal_distance: Distance (m) to it along the path, or straight where that is more.
        velocities: Shape (B, T, 3): body frame, in each step.
        poses: Shape (B, T, 3): after each step.
        way: How far each is free, and costmap costs up to there.
        checker: The obstacles.
        path: Shape (P, 2), P >= 2: points (m) ahead, POINT_SPACING apart, from the one nearest to the robot on.
        path_is_free: Shape (P,), bool: whether the costmap's cost is below inscribed.
        halfway, ends: Shape (B, 2): of each trajectory after half its time, and at its end, the distance (m) from the
            path, and the progress (m) along it from the robot's place.
        furthest: Index of the point of the path reached by the trajectory that gets farthest along it.
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
        """Which trajectories collide, bool of shape (B,)."""
        return self.checker.meets_something(
            self.poses, np.full(len(self.poses), self.poses.shape[1]), self.way.steps)


@dataclass(frozen=True)
class CriticParameters(ParameterSet):
    """Parameters of every critic of MPPI."""

    enabled: bool = parameter(True, "use this critic")
    cost_weight: float = parameter(1.0, "weight of this critic in the sum of costs", minimum=0.0)
    cost_power: int = parameter(1, "power to which the weighted cost is raised", minimum=1, maximum=10)


class CriticFunction(Plugin, abc.ABC):
    """Scores sampled trajectories by one criterion. Source: Nav2's critic of the same name."""

    Parameters = CriticParameters
    parameters: CriticParameters

    def cost(self, data: Rollouts) -> Any:
        """Return the weighted cost of each trajectory, shape (B,), or 0 where the critic does not apply."""
        p = self.parameters
        if not p.enabled:
            return 0.0
        cost = p.cost_weight * self.score(data)
        return cost if p.cost_power == 1 else cost ** p.cost_power

    @abc.abstractmethod
    def score(self, data: Rollouts) -> Any:
        """Return the unweighted cost of each trajectory, (B,), 0 or above; or 0 where the critic does not apply."""
