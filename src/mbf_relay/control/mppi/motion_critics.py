"""Critics of velocities: limits, driving backwards, rotation, and the motors' deadband."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Tuple

import numpy as np

from mbf_relay.control.mppi.critic import CriticFunction, CriticParameters, Rollouts
from mbf_relay.control.mppi.parameters import ACKERMANN
from mbf_relay.parameters import parameter


@dataclass(frozen=True)
class ConstraintCriticParameters(CriticParameters):
    """Parameters of MPPI's ConstraintCritic."""

    cost_weight: float = parameter(4.0, "weight of this critic in the sum of costs", minimum=0.0)


class ConstraintCritic(CriticFunction):
    """Charges speed above its limits and, with Ackermann, rotation beyond the turning circle, integrated over time."""

    Parameters = ConstraintCriticParameters
    parameters: ConstraintCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres."""
        p = data.parameters
        along, turn = data.velocities[:, :, 0], data.velocities[:, :, 2]
        speed = np.copysign(np.hypot(along, data.velocities[:, :, 1]), along) if p.max_vel_y else along
        backwards = math.hypot(p.min_vel_x, p.max_vel_y) * (1.0 if p.min_vel_x > 0.0 else -1.0)
        if p.motion_model != ACKERMANN and backwards <= speed.min() and speed.max() <= p.max_vel_trans:
            return 0.0  # the usual case
        beyond = np.maximum(0.0, speed - p.max_vel_trans) + np.maximum(0.0, backwards - speed)
        if p.motion_model == ACKERMANN:
            beyond += np.maximum(0.0, np.abs(turn) * p.min_turning_r - np.abs(along))
        return beyond.sum(axis=1) * p.model_dt


@dataclass(frozen=True)
class PreferForwardCriticParameters(CriticParameters):
    """Parameters of MPPI's PreferForwardCritic."""

    cost_weight: float = parameter(5.0, "weight of this critic in the sum of costs", minimum=0.0)
    threshold_to_consider: float = parameter(
        0.5, "distance to the goal below which this critic is off", "m", minimum=0.0)


class PreferForwardCritic(CriticFunction):
    """Charges metres driven backwards."""

    Parameters = PreferForwardCriticParameters
    parameters: PreferForwardCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres."""
        if data.goal_distance < self.parameters.threshold_to_consider:
            return 0.0
        return np.maximum(0.0, -data.velocities[:, :, 0]).sum(axis=1) * data.parameters.model_dt


@dataclass(frozen=True)
class TwirlingCriticParameters(CriticParameters):
    """Parameters of MPPI's TwirlingCritic."""

    cost_weight: float = parameter(10.0, "weight of this critic in the sum of costs", minimum=0.0)


class TwirlingCritic(CriticFunction):
    """Charges the mean rotational speed, except within xy_goal_tolerance of the goal."""

    Parameters = TwirlingCriticParameters
    parameters: TwirlingCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return rad/s."""
        if data.goal_distance <= data.parameters.xy_goal_tolerance:
            return 0.0
        return np.abs(data.velocities[:, :, 2]).mean(axis=1)


@dataclass(frozen=True)
class VelocityDeadbandCriticParameters(CriticParameters):
    """Parameters of MPPI's VelocityDeadbandCritic."""

    cost_weight: float = parameter(35.0, "weight of this critic in the sum of costs", minimum=0.0)
    deadband_velocities: Tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), "velocities x, y (m/s) and theta (rad/s) below which the robot does not move; lower ones are "
        "charged")


class VelocityDeadbandCritic(CriticFunction):
    """Charges velocities in the deadband, so low that the robot would not move."""

    Parameters = VelocityDeadbandCriticParameters
    parameters: VelocityDeadbandCriticParameters

    def score(self, data: Rollouts) -> Any:
        """Return metres plus radians: the shortfall integrated over time."""
        dead = np.abs(np.array(self.parameters.deadband_velocities))
        if not data.parameters.max_vel_y:
            dead[1] = 0.0
        short = np.maximum(0.0, dead - np.abs(data.velocities))
        return short.sum(axis=(1, 2)) * data.parameters.model_dt
