"""The critic of predicted moving obstacles."""

from __future__ import annotations

import numpy as np

from mbf_relay.control.critics.critic import Critic, CriticData
from mbf_relay.control.foresight import Foresight
from mbf_relay.control.trajectories import Trajectories


class ForesightCost(Critic):
    """Charges contacts with predicted moving obstacles, earlier ones more, and rules out those it could not stop for.

    Standing still is charged like every trajectory, so that a robot in somebody's way steps aside.
    """

    judges_place = True
    passes_by_itself = True

    @property
    def scale(self) -> float:
        """foresight_scale, in the path critic's unit; 0 where `foresight` is off."""
        p = self.parameters
        return p.foresight_scale * p.path_distance_bias if p.foresight else 0.0

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return 0 to 1, or RULED_OUT."""
        foresight = Foresight(data.checker.costmap, data.pose, data.now, self.parameters)
        if foresight.is_blind:
            return np.zeros(len(trajectories))
        t = trajectories
        meetings = foresight.meetings(t.poses, np.minimum(t.counts, np.maximum(1, t.free)), t.steps)
        return foresight.costs(meetings, t.needed * t.steps, data.pose)
