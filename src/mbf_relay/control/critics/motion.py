"""Critics of velocities: turning, driving backwards, changes of the turn, and low speeds."""

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
    """Charges driving backwards, as a share of the top speed.

    Source: base_local_planner's PreferForwardCostFunction, without its charge on turning, which is Twirling's.
    """

    @property
    def scale(self) -> float:
        """prefer_forward_scale, times path_distance_bias."""
        return self.parameters.prefer_forward_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 to 1."""
        return np.maximum(0.0, -trajectories.velocities[:, 0]) / max(self.parameters.max_vel_trans, 1e-6)


class Steady(Critic):
    """Charges changes of the rotational velocity (rad/s), so that noise of the pose does not cause swinging."""

    @property
    def scale(self) -> float:
        """steady_scale, times path_distance_bias."""
        return self.parameters.steady_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return rad/s."""
        changes: np.ndarray = np.abs(trajectories.velocities[:, 2] - data.velocity.theta)
        return changes


class CounterSteering(Critic):
    """Charges turning to the other side than last, less in narrow places.

    The charge is constant from WHOLE on. So the robot drives straight past bends of a degree or two, and takes
    larger ones as they are, since after the first such command the sides are swapped.

    It keeps the side for a new goal, because goals that replace each other come while the robot drives.
    """

    STRAIGHT = 0.02  # share of the top rotational speed up to which a command counts as straight
    WHOLE = 0.04  # share of the top rotational speed from which on the charge is full
    TURNED = 0.25  # rad that the window can turn within sim_time, below which the charge is reduced in proportion

    def __init__(self, name: str, parameters: DwaParameters) -> None:
        super().__init__(name, parameters)
        self._side = 0.0

    @property
    def scale(self) -> float:
        """counter_steering_scale, times path_distance_bias."""
        return self.parameters.counter_steering_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 to 1."""
        whole = max(self.WHOLE * self.parameters.max_vel_theta, 1e-6)
        charge = np.minimum(np.maximum(-self._side * trajectories.velocities[:, 2] / whole, 0.0), 1.0)
        reach = 0.5 * (data.window.high.theta - data.window.low.theta) * self.parameters.sim_time
        return np.asarray(data.horizon_scale * min(1.0, reach / self.TURNED) * charge)

    def driven(self, command: Twist2D, data: CriticData) -> None:
        """Note the side of a turn."""
        if abs(command.theta) > self.STRAIGHT * self.parameters.max_vel_theta:
            self._side = math.copysign(1.0, command.theta)


class Slow(Critic):
    """Charges velocities below both min_vel_trans and min_vel_theta.

    dwa_local_planner does not sample them. With the tutorials' high min_vel_theta that leaves a robot in a narrow
    place a fast turn or nothing, so that it oscillates; here they are used where nothing else is possible.
    """

    @property
    def scale(self) -> float:
        """slow_scale, times path_distance_bias."""
        return self.parameters.slow_scale * self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 or 1."""
        return too_slow(self.parameters, data.window, trajectories.velocities).astype(float)
