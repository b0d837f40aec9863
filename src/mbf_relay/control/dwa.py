"""The dynamic window approach, by dwa_local_planner's parameters."""

from __future__ import annotations

import dataclasses
from numbers import Real
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.control.critics import CRITICS
from mbf_relay.control.critics.critic import Critic, CriticData
from mbf_relay.control.cycle import ControlCycle
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.explanation import Explanation
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.report import CycleReport
from mbf_relay.control.trajectories import STANDING, Trajectories, is_fastest, roll_out, sample, window_of
from mbf_relay.geometry import Twist2D
from mbf_relay.planning.path import Path
from mbf_relay.plugins import failures_of, find_class

LEAST_GAIN = 0.01  # robot's widths of distance to the path by which a trajectory's end must be better than standing
LEAST_SHARE = 0.1  # of the way of the fastest velocity: a smaller gain will do for a robot that begins to accelerate


class DwaController(PathFollower):
    """Samples the dynamic window, simulates each velocity, has critics score the batch, and takes the cheapest.

    Source: Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance" (1997), and
    dwa_local_planner/DWAPlannerROS, whose parameters it reads.

    Attributes:
        critics: The critics in the order of evaluation.
        trajectories: The batch of the last cycle that sampled one, None before.
        explanation: The scores of that cycle, None before.
    """

    Parameters = DwaParameters
    parameters: DwaParameters
    dynamic_config = "mbf_relay.cfg.DwaConfig"

    def __init__(self, name: str, parameters: DwaParameters) -> None:
        super().__init__(name, parameters)
        self.odom_topic = parameters.odom_topic
        self.critics: List[Critic] = _make_critics(parameters)
        self.trajectories: Optional[Trajectories] = None
        self.explanation: Optional[Explanation] = None

    def reconfigure(self, parameters: DwaParameters) -> None:
        """Take new parameters; with an unchanged list, critics keep what they remember."""
        if parameters.critics != self.parameters.critics:
            self.critics = _make_critics(parameters)
        for critic in self.critics:
            critic.reconfigure(parameters)
        super().reconfigure(parameters)

    @property
    def lookahead(self) -> float:
        """forward_point_distance."""
        return self.parameters.forward_point_distance

    @property
    def horizon(self) -> float:
        """sim_time."""
        return self.parameters.sim_time

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

    def drive(self, cycle: ControlCycle) -> Twist2D:
        """Return the command of the cheapest trajectory, or one that only turns or brakes."""
        self.trajectories, data = self._rolled_out(cycle)
        self.explanation = self._score(self.trajectories, data)
        turns = self._only_turns(self.explanation)
        if turns:
            instead = self._turn_or_brake(cycle, self.explanation)
            if instead is not None:
                return instead
        winner = self.explanation.winner
        if cycle.window.can_stand:
            self.explanation, winner = self._that_gets_on(self.explanation, turns, cycle)
        once_passed = self.explanation.once_passed()
        if winner is None:
            if self._worthwhile(once_passed, cycle) is not None:  # what holds the robot goes away by itself: wait
                return cycle.window.still
            raise self.nothing_left(cycle, str(self.explanation))
        command = Twist2D(*map(float, self.trajectories.commands[winner]))
        if once_passed.winner == winner:  # evading somebody is not noted as a change of direction
            for critic in self.critics:
                critic.driven(command, data)
        return command

    def _rolled_out(self, cycle: ControlCycle) -> Tuple[Trajectories, CriticData]:
        """Return the trajectories of the samples, standing still as the last one, and the data for the critics."""
        parameters, state, window = self.parameters, cycle.state, cycle.window
        if not parameters.use_dwa:
            window = window_of(parameters, cycle.velocity, parameters.sim_time, cycle.speed, cycle.turn)
        velocities = np.vstack((sample(parameters, window, cycle.speed), np.zeros((1, 3))))
        trajectories = roll_out(
            parameters, cycle.checker, state.pose, cycle.velocity, velocities, state.period, cycle.path.remaining,
            parameters.sim_time * cycle.horizon_scale,
        )
        return trajectories, CriticData(
            state.now + state.delay, state.pose, cycle.velocity, cycle.path, cycle.checker, window, cycle.horizon_scale)

    def _score(self, trajectories: Trajectories, data: CriticData) -> Explanation:
        asked = [critic for critic in self.critics if _weight(critic) > 0.0]
        scores = np.zeros((len(asked), len(trajectories)))
        for row, critic in zip(scores, asked):
            with failures_of(critic, "critic"):
                row[:] = np.multiply(critic.scale, critic.score(trajectories, data))
        for lowest, critic in zip(scores.min(axis=1), asked):
            if not lowest > -np.inf:  # NaN as well: either would make what others rule out the winner
                with failures_of(critic, "critic"):
                    raise ValueError("it scored a trajectory NaN or -inf")
        return Explanation.of(asked, scores, trajectories.velocities)

    def _only_turns(self, explanation: Explanation) -> bool:
        """Return whether the winner turns on the spot, or nearly."""
        if explanation.winner is None:
            return False
        speed = np.hypot(*explanation.velocities[explanation.winner, :2])
        return bool(speed < STANDING * self.parameters.max_vel_trans)

    def _turn_or_brake(self, cycle: ControlCycle, explanation: Explanation) -> Optional[Twist2D]:
        """Return what replaces a winner that only turns: a turn that ends when the robot faces the path, or braking.

        None where the robot faces the path and can stand, or the winner is as fast as the window allows.
        """
        turn = self.turn_to_path(cycle, 0.0)
        if turn is not None:
            return turn
        # it faces the path and still turns: without braking it would swing to and fro
        if not cycle.window.can_stand and not is_fastest(cycle.window, explanation.velocities[explanation.winner]):
            return cycle.window.still
        return None

    def _that_gets_on(
        self, explanation: Explanation, turns: bool, cycle: ControlCycle
    ) -> Tuple[Explanation, Optional[int]]:
        """Return the explanation to follow for a robot that can stand, and its winner; None if none is worthwhile.

        If the critics together prefer standing, or just turning (`turns`), those with `yields_where_held` are left
        out. If they still do, although the path is free and the robot faces it, finite costs of critics with
        `judges_way` are left out as well: else a robot would stay before a narrower place. base_local_planner never
        compares with standing.
        """
        winner = self._worthwhile(explanation, cycle)
        if winner is not None and not turns:
            return explanation, winner
        getting_on = explanation.where_held()
        other = self._worthwhile(getting_on, cycle)
        if other is None and self._is_free_ahead(cycle):
            getting_on = getting_on.without_charges_for_the_way()
            other = self._worthwhile(getting_on, cycle)
        return (explanation, winner) if other is None and winner is not None else (getting_on, other)

    def _is_free_ahead(self, cycle: ControlCycle) -> bool:
        """Return whether the path ahead is free, and the robot faces it or can turn to it."""
        return cycle.path.first_blocked(cycle.checker) is None and not self._no_room_to_turn(cycle)

    def _worthwhile(self, explanation: Explanation, cycle: ControlCycle) -> Optional[int]:
        """Return the winner, None where it ends at no better place than the robot is at.

        Critics with `judges_place` decide that; without any, every winner counts. So a robot that could only creep to
        and fro before an obstacle fails with an error.
        """
        if explanation.winner is None:
            return None
        costs = explanation.scores[explanation.judges_place]
        if len(costs) == 0:
            return explanation.winner
        gain = costs[:, -1].sum() - costs[:, explanation.winner].sum()
        reach = float(np.hypot(*explanation.velocities[:, :2].T).max()) * self.parameters.sim_time
        least = min(LEAST_GAIN * cycle.checker.costmap.width, LEAST_SHARE * reach) * self.parameters.path_distance_bias
        return explanation.winner if gain > least else None

    def report(self, cycle: ControlCycle, drove: bool) -> CycleReport:
        """Return the report with the batch of trajectories, their costs and the explanation."""
        p = self.parameters
        weights = (p.path_distance_bias, p.goal_distance_bias, p.occdist_scale) if p.publish_cost_grid_pc else None
        plain = dataclasses.replace(super().report(cycle, drove), cost_weights=weights)
        if not drove or self.trajectories is None or self.explanation is None:
            return plain
        winner, trajectory = self.explanation.winner, plain.trajectory
        if winner is not None:
            trajectory = self.trajectories.poses[winner, : self.trajectories.free[winner]]
        return dataclasses.replace(
            plain, trajectory=trajectory, trajectories=self.trajectories, totals=self.explanation.totals,
            explanation=self.explanation, shows_trajectories=p.publish_traj_pc,
        )


def _make_critics(parameters: DwaParameters) -> List[Critic]:
    return [find_class(name, Critic, CRITICS)(name, parameters) for name in parameters.critics]


def _weight(critic: Critic) -> float:
    with failures_of(critic, "critic"):
        scale = critic.scale
        if not isinstance(scale, Real):
            kind = type(scale).__name__
            raise TypeError(f"its scale is of type {kind}; it must be a number, and a @property where it is computed")
        return float(scale)
