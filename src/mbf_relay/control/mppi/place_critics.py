"""Critics of obstacles and of the goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbf_relay.control.mppi.critic import CriticFunction, CriticParameters, Rollouts
from mbf_relay.control.mppi.parameters import DIFF_DRIVE
from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL
from mbf_relay.geometry import normalize_angles
from mbf_relay.parameters import parameter, without_effect


@dataclass(frozen=True)
class CostCriticParameters(CriticParameters):
    """Parameters of MPPI's CostCritic."""

    cost_weight: float = parameter(3.81, "weight of this critic in the sum of costs", minimum=0.0)
    consider_footprint: bool = without_effect(True, "the footprint is always checked along the trajectory")
    critical_cost: float = parameter(
        300.0, "cost added where the robot's centre passes a cell of inscribed cost", minimum=0.0)
    collision_cost: float = parameter(1000000.0, "cost of a trajectory that collides", minimum=0.0)
    near_goal_distance: float = parameter(
        0.5, "distance to the goal below which costs are not charged, only critical_cost and collision_cost", "m",
        minimum=0.0)
    inflation_layer_name: str = without_effect("", "costs are the costmap's")
    trajectory_point_step: int = without_effect(2, "every step is checked", minimum=1)


class CostCritic(CriticFunction):
    """Charges the costmap's costs along the trajectory, as a share of a lethal cell's."""

    Parameters = CostCriticParameters
    parameters: CostCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return the mean cost over 254; far more for a trajectory that collides."""
        p, count = self.parameters, data.poses.shape[1]
        costs = np.zeros(len(data.poses)) if data.goal_distance < p.near_goal_distance else data.way.summed_costs
        costs = np.where(data.way.highest_costs >= INSCRIBED, costs + p.critical_cost, costs)
        return np.where(data.touches, p.collision_cost, costs) / (LETHAL * count)


@dataclass(frozen=True)
class ObstaclesCriticParameters(CriticParameters):
    """Parameters of MPPI's ObstaclesCritic."""

    cost_weight: float = parameter(1.0, "factor on repulsion_weight and critical_weight", minimum=0.0)
    repulsion_weight: float = parameter(
        1.5, "weight of the mean distance by which a trajectory is nearer to obstacles than inflation_radius",
        minimum=0.0)
    critical_weight: float = parameter(
        20.0, "weight of the distances by which it is nearer to obstacles than collision_margin_distance", minimum=0.0)
    collision_cost: float = parameter(100000.0, "cost of a trajectory that collides", minimum=0.0)
    collision_margin_distance: float = parameter(
        0.1, "distance to an obstacle, from the inscribed circle, below which critical_weight applies", "m",
        minimum=0.0)
    inflation_radius: float = parameter(
        0.55, "distance to an obstacle, from the inscribed circle, below which repulsion_weight applies", "m",
        above=0.0)
    near_goal_distance: float = parameter(
        0.5, "distance to the goal below which repulsion_weight does not apply", "m", minimum=0.0)
    consider_footprint: bool = without_effect(True, "the footprint is always checked along the trajectory")
    inflation_layer_name: str = without_effect("", "distances are the costmap's")


class ObstaclesCritic(CriticFunction):
    """Charges nearness to obstacles, measured from the inscribed circle, in place of CostCritic."""

    Parameters = ObstaclesCriticParameters
    parameters: ObstaclesCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return the sum of both weighted costs; far more for a trajectory that collides."""
        p = self.parameters
        distances = np.maximum(0.0, data.checker.clearances_at(data.poses) - data.checker.costmap.inscribed_radius)
        critical = np.maximum(0.0, p.collision_margin_distance - distances).sum(axis=1)
        costs = p.critical_weight * critical
        if data.goal_distance >= p.near_goal_distance:
            costs = costs + p.repulsion_weight * np.maximum(0.0, p.inflation_radius - distances).mean(axis=1)
        return np.where(data.touches, p.collision_cost, costs)


@dataclass(frozen=True)
class GoalCriticParameters(CriticParameters):
    """Parameters of MPPI's GoalCritic."""

    cost_weight: float = parameter(5.0, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        1.4, "distance to the goal above which this critic is off", "m", minimum=0.0)


class GoalCritic(CriticFunction):
    """Charges the mean distance (m) to the goal, within threshold_to_consider."""

    Parameters = GoalCriticParameters
    parameters: GoalCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres."""
        if data.goal_distance > self.parameters.threshold_to_consider:
            return 0.0
        return np.sqrt((data.poses[:, :, 0] - data.goal.x) ** 2 + (data.poses[:, :, 1] - data.goal.y) ** 2).mean(axis=1)


@dataclass(frozen=True)
class GoalAngleCriticParameters(CriticParameters):
    """Parameters of MPPI's GoalAngleCritic."""

    cost_weight: float = parameter(3.0, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        0.5, "distance to the goal above which this critic is off", "m", minimum=0.0)


class GoalAngleCritic(CriticFunction):
    """Charges the mean angle (rad) to the goal's heading, within threshold_to_consider.

    It is off for DiffDrive, which turns on the spot at the goal: turning sooner would lead it off its way.
    """

    Parameters = GoalAngleCriticParameters
    parameters: GoalAngleCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return radians."""
        if data.goal_distance > self.parameters.threshold_to_consider or data.parameters.motion_model == DIFF_DRIVE:
            return 0.0
        return np.abs(normalize_angles(data.poses[:, :, 2] - data.goal.theta)).mean(axis=1)
