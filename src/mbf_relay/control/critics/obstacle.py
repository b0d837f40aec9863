"""The obstacle critic."""

from __future__ import annotations

import numpy as np

from mbf_relay.control.critics.critic import RULED_OUT, Critic, CriticData
from mbf_relay.control.trajectories import Trajectories
from mbf_relay.costmap.cost_grid import INSCRIBED


class ObstacleCost(Critic):
    """Rules out trajectories that collide before the robot could stop, and charges the highest cost under its centre.

    Source: base_local_planner's ObstacleCostFunction. That one discards every trajectory that collides within sim_time.
    Here only those are discarded that collide before the robot could have stopped, with stop_time_buffer; one that
    collides later counts up to there, at the cost of an inscribed cell. A trajectory that leaves the costmap counts up
    to its edge, without an extra cost.

    Where the footprint touches already, trajectories remain that touch no more than now.
    """

    judges_way = True
    rules_out_contacts = True

    @property
    def scale(self) -> float:
        """occdist_scale, and above 0 in any case: a critic of weight 0 would not rule out collisions."""
        return max(self.parameters.occdist_scale, 1e-9)

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return the highest cost passed (or their sum, with sum_scores)."""
        costs = trajectories.summed_costs if self.parameters.sum_scores else trajectories.highest_costs
        touches = data.checker.meets_something(trajectories.poses, trajectories.counts, trajectories.free)
        costs = np.where(touches, np.maximum(costs, INSCRIBED), costs)
        return np.where(trajectories.free < trajectories.needed, RULED_OUT, costs)
