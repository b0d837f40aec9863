"""The obstacle critic."""

from __future__ import annotations

import numpy as np

from mbf_relay.control.critics.critic import RULED_OUT, Critic, CriticData
from mbf_relay.control.trajectories import Trajectories
from mbf_relay.costmap.cost_grid import INSCRIBED


class ObstacleCost(Critic):
    """Rules out what the robot could not stop from, and charges the highest cost the robot's centre passes.

    Source: base_local_planner's ObstacleCostFunction. Where that discards every trajectory that touches anything within
    sim_time, this one discards those that touch before the robot could have stopped, with stop_time_buffer to spare;
    one that touches later is worth what it reaches until then, at the cost of an inscribed cell. Where the costmap ends
    nothing is touched: one that leads on from there is worth what it reaches on it, at no cost.

    Where the footprint touches already, for an obstacle came near or was seen late, what touches no more than now is
    left.
    """

    judges_way = True
    rules_out_contacts = True

    @property
    def scale(self) -> float:
        """occdist_scale, and above 0 in any case: safety has no switch."""
        return max(self.parameters.occdist_scale, 1e-9)

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return the highest cost passed (or their sum, with sum_scores)."""
        costs = trajectories.summed_costs if self.parameters.sum_scores else trajectories.highest_costs
        touches = data.checker.meets_something(trajectories.poses, trajectories.counts, trajectories.free)
        costs = np.where(touches, np.maximum(costs, INSCRIBED), costs)
        return np.where(trajectories.free < trajectories.needed, RULED_OUT, costs)
