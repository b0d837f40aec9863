"""The dynamic window approach, by dwa_local_planner's parameters."""

from __future__ import annotations

import dataclasses
from typing import List, Optional

import numpy as np

from mbf_relay.control.critics import CRITICS
from mbf_relay.control.critics.critic import Critic, Scene
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.explanation import Explanation
from mbf_relay.control.follower import PathFollower, Surroundings
from mbf_relay.control.report import CycleReport
from mbf_relay.control.trajectories import STANDING, Trajectories, roll_out, sample, window_of
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.plugins import find_class
from mbf_relay.planning.path import Path

PLACE = ("path", "goal", "alignment", "goal_front")
NOSES = ("alignment", "goal_front")
"""Not asked where they hold the robot: at a bend its nose may be as near to the path as it gets where it stands."""

LEAST_GAIN = 0.002  # m off the path by which a trajectory's end must be better than standing


class DwaController(PathFollower):
    """Samples velocities in reach, drives each forward, has critics score the batch, and takes the cheapest.

    Source: Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance" (1997), and
    dwa_local_planner/DWAPlannerROS, whose parameters it reads.

    Attributes:
        critics: The critics in the order they are asked.
        trajectories: The batch of the last cycle that sampled one, None before.
        explanation: Why that cycle ended as it did, None before.
    """

    Parameters = DwaParameters

    def __init__(self, name: str, parameters: DwaParameters) -> None:
        super().__init__(name, parameters)
        self.critics: List[Critic] = _make_critics(parameters)
        self.trajectories: Optional[Trajectories] = None
        self.explanation: Optional[Explanation] = None

    def reconfigure(self, parameters: DwaParameters) -> None:
        """Take new parameters; critics that stay keep what they remember."""
        if parameters.critics != self.parameters.critics:
            self.critics = _make_critics(parameters)
        for critic in self.critics:
            critic.reconfigure(parameters)
        super().reconfigure(parameters)

    @property
    def lookahead(self) -> float:
        """forward_point_distance, and 0.2 m where that is less."""
        return max(0.2, self.parameters.forward_point_distance)

    @property
    def turn_to_path_angle(self) -> float:
        """The parameter of that name."""
        return self.parameters.turn_to_path_angle

    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path`; see Controller."""
        super().set_path(path, is_new_goal)
        if is_new_goal:
            for critic in self.critics:
                critic.reset()

    def drive(self, around: Surroundings) -> Twist2D:
        """Return the command of the cheapest trajectory."""
        parameters, state = self.parameters, around.state
        window = around.window
        if not parameters.use_dwa:
            window = window_of(parameters, around.velocity, parameters.sim_time, around.speed, around.turn)
        velocities = np.vstack((sample(parameters, window, around.speed), np.zeros((1, 3))))
        self.trajectories = roll_out(
            parameters, around.view, state.pose, around.velocity, velocities, state.period, around.path.remaining,
            parameters.sim_time * around.focus,
        )
        scene = Scene(state.now, state.pose, around.velocity, around.path, around.view, window, around.focus)
        self.explanation = self._score(self.trajectories, scene)
        winner = self.explanation.winner
        stands = around.window.contains(STOP)
        if winner is not None and np.hypot(*velocities[winner, :2]) < STANDING:
            turn = self.turn_to_path(around, 0.0)
            if turn is not None:
                return turn
        if stands and not self._is_worthwhile(self.explanation):
            self.explanation = self.explanation.without(NOSES)
            winner = self.explanation.winner if self._is_worthwhile(self.explanation) else None
        if winner is None:
            raise self.nothing_left(around, str(self.explanation))
        command = Twist2D(*map(float, self.trajectories.commands[winner]))
        for critic in self.critics:
            critic.driven(command, scene)
        return command

    def report(self, around: Surroundings, drove: bool) -> CycleReport:
        """Return the batch of trajectories, their costs and why the winner won."""
        plain = super().report(around, drove)
        if not drove or self.trajectories is None or self.explanation is None:
            return plain
        winner, trajectory = self.explanation.winner, plain.trajectory
        if winner is not None:
            trajectory = self.trajectories.poses[winner, : self.trajectories.free[winner]]
        return dataclasses.replace(
            plain, trajectory=trajectory, trajectories=self.trajectories, totals=self.explanation.totals,
            explanation=str(self.explanation),
        )

    def _is_worthwhile(self, explanation: Explanation) -> bool:
        """Tell whether the winner leads anywhere: whether its end is a better place than here, by what critics of place say.

        A robot that creeps to and fro before an obstacle is not on its way; whoever sent it should hear of that.
        """
        if explanation.winner is None:
            return False
        place = np.array([name in PLACE for name in explanation.critics])
        costs = explanation.scores[place]
        gain = costs[:, -1].sum() - costs[:, explanation.winner].sum()
        return bool(gain > LEAST_GAIN * self.parameters.path_distance_bias)

    def _score(self, trajectories: Trajectories, scene: Scene) -> Explanation:
        asked = [critic for critic in self.critics if critic.scale > 0.0]
        scores = np.zeros((len(asked), len(trajectories)))
        for row, critic in zip(scores, asked):
            row[:] = critic.scale * critic.score(trajectories, scene)
        return Explanation.of([critic.name for critic in asked], scores, trajectories.velocities)


def _make_critics(parameters: DwaParameters) -> List[Critic]:
    return [find_class(name, Critic, CRITICS)(name, parameters) for name in parameters.critics]
