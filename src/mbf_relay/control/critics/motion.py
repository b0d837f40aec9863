"""The critics of motion: turning, driving backwards, changing one's mind."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.control.critics.critic import Critic, CriticData
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.trajectories import Trajectories, too_slow
from mbf_relay.geometry import Twist2D


class Twirling(Critic):
    """Charges the rotational speed (rad/s), as base_local_planner's TwirlingCostFunction."""

    @property
    def scale(self) -> float:
        """twirling_scale."""
        return self.parameters.twirling_scale

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return rad/s."""
        turns: np.ndarray = np.abs(trajectories.velocities[:, 2])
        return turns


class PreferForward(Critic):
    """Charges driving backwards, by its share of the top speed.

    Source: base_local_planner's PreferForwardCostFunction, without its charge on turning, which is Twirling's.
    """

    @property
    def scale(self) -> float:
        """prefer_forward_scale, in the path critic's unit."""
        return self.parameters.prefer_forward_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 to 1."""
        return np.maximum(0.0, -trajectories.velocities[:, 0]) / max(self.parameters.max_vel_trans, 1e-6)


class Steady(Critic):
    """Charges a change of the rotational velocity (rad/s), so that noise of the pose does not become unrest."""

    @property
    def scale(self) -> float:
        """steady_scale, in the path critic's unit."""
        return self.parameters.steady_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return rad/s."""
        changes: np.ndarray = np.abs(trajectories.velocities[:, 2] - data.velocity.theta)
        return changes


class CounterSteering(Critic):
    """Charges turning to the other side than the robot turned last, less where it is narrow.

    The charge is the same from WHOLE on, and the side is the other one once it was worth it: a robot goes straight on
    rather than after each bend of a path by a degree or two, and a bend worth more than that it takes as it is.

    A new goal is no reason to forget the side: goals that replace each other find a robot that drives.
    """

    STRAIGHT = 0.02  # of the top rotational speed: a slower turn has no side
    WHOLE = 0.04  # of the top rotational speed: a turn from which on all is charged
    TURNED = 0.25  # rad: within sim_time by the turns in reach; of a robot that can turn less than that less is charged

    def __init__(self, name: str, parameters: DwaParameters) -> None:
        super().__init__(name, parameters)
        self._side = 0.0

    @property
    def scale(self) -> float:
        """counter_steering_scale, in the path critic's unit."""
        return self.parameters.counter_steering_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 to 1."""
        whole = max(self.WHOLE * self.parameters.max_vel_theta, 1e-6)
        charge = np.minimum(np.maximum(-self._side * trajectories.velocities[:, 2] / whole, 0.0), 1.0)
        reach = 0.5 * (data.window.high.theta - data.window.low.theta) * self.parameters.sim_time
        return np.asarray(data.horizon_scale * min(1.0, reach / self.TURNED) * charge)

    def driven(self, command: Twist2D, data: CriticData) -> None:
        """Note the side."""
        if abs(command.theta) > self.STRAIGHT * self.parameters.max_vel_theta:
            self._side = math.copysign(1.0, command.theta)


class Slow(Critic):
    """Charges creeping: translation below min_vel_trans with a turn below min_vel_theta.

    dwa_local_planner leaves them out altogether. With a minimum turn as high as the tutorials' that leaves a robot in a
    narrow place the choice between a spin and nothing, and it hunts; here they are for where nothing else serves.
    """

    @property
    def scale(self) -> float:
        """slow_scale, in the path critic's unit."""
        return self.parameters.slow_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 or 1."""
        return too_slow(self.parameters, data.window, trajectories.velocities).astype(float)
