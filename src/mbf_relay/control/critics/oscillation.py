"""The oscillation critic: no second reversal of a motion until the robot has moved far enough."""

from __future__ import annotations

from typing import Dict, Optional

import numpy as np

from mbf_relay.control.critics.critic import RULED_OUT, Critic, CriticData
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.trajectories import Trajectories
from mbf_relay.geometry import Pose2D, Twist2D

COMPONENTS = ("x", "y", "theta")


class Oscillation(Critic):
    """Rules out reversing a motion a second time before the robot has moved or turned far enough.

    Reversals along x count always; those sideways and of the rotation only while the robot drives no faster than
    min_vel_trans, since otherwise they are steering. A component that was reversed may not be reversed again until the
    robot has moved oscillation_reset_dist or turned oscillation_reset_angle from there. A ban that keeps the robot
    standing yields, since it could never get that far; DWAPlanner lifts bans with each new plan.

    Source: base_local_planner's OscillationCostFunction.
    """

    yields_where_held = True

    def __init__(self, name: str, parameters: DwaParameters) -> None:
        super().__init__(name, parameters)
        self._direction: Dict[str, int] = {}
        self._allowed: Dict[str, int] = {}
        self._since: Optional[Pose2D] = None

    @property
    def scale(self) -> float:
        """1; it only rules out."""
        return 1.0

    @property
    def bans(self) -> Dict[str, int]:
        """The components that may go one way only, each with the sign (+1, -1) allowed."""
        return dict(self._allowed)

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 or RULED_OUT."""
        if not self._allowed:
            return np.zeros(len(trajectories))
        banned = np.zeros(len(trajectories), dtype=bool)
        for component, sign in self._allowed.items():
            banned |= trajectories.velocities[:, COMPONENTS.index(component)] * sign < 0.0
        return np.where(banned, RULED_OUT, 0.0)

    def driven(self, command: Twist2D, data: CriticData) -> None:
        """Note reversals and lift bans."""
        steering = abs(command.x) > self.parameters.min_vel_trans
        for component, value in zip(COMPONENTS, command):
            if value == 0.0 or (steering and component != "x"):
                continue
            sign = 1 if value > 0.0 else -1
            if self._direction.get(component, sign) != sign:
                self._allowed[component] = sign
                self._since = data.pose
            self._direction[component] = sign
        if self._allowed and self._moved(data.pose):
            self.reset()

    def reset(self) -> None:
        """Lift every ban."""
        self._direction.clear()
        self._allowed.clear()

    def _moved(self, pose: Pose2D) -> bool:
        assert self._since is not None
        p = self.parameters
        return self._since.is_apart(pose, p.oscillation_reset_dist, p.oscillation_reset_angle)
