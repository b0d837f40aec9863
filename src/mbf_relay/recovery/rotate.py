"""Turn round once, so that sensors see all around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator

import numpy as np

from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.geometry import Twist2D, angle_between
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.recovery.maneuver import Place, look, measured
from mbf_relay.recovery.recovery import Recovery, RecoveryContext


@dataclass(frozen=True)
class RotateParameters(ParameterSet):
    """Parameters of Rotate, by rotate_recovery's names and defaults."""

    sim_granularity: float = parameter(0.017, "turn between checked headings", "rad", above=0.0)
    frequency: float = parameter(20.0, "read, and without effect: steps come at the server's rate", "Hz", above=0.0)
    acc_lim_theta: float = parameter(3.2, "rotational acceleration", "rad/s^2", above=0.0, aliases=("acc_lim_th",))
    max_vel_theta: float = parameter(1.0, "top rotational speed", "rad/s", above=0.0, aliases=("max_rotational_vel",))
    min_in_place_vel_theta: float = parameter(
        0.4, "slowest turn, except to start and to brake", "rad/s", minimum=0.0, aliases=("min_in_place_rotational_vel",)
    )
    yaw_goal_tolerance: float = parameter(0.1, "how exactly it comes back to its first heading", "rad", above=0.0)

    def check(self) -> None:
        """Refuse speeds that contradict each other."""
        if self.min_in_place_vel_theta > self.max_vel_theta:
            raise ValueError(
                f"parameter min_in_place_vel_theta is {self.min_in_place_vel_theta}; it must be at most max_vel_theta, "
                f"which is {self.max_vel_theta}"
            )


class Rotate(Recovery):
    """Turns a full circle to the left; what is left of one to the right, where something is in the way.

    Before each step the footprint is laid along the rest of the arc on the costmap as it is then.

    Source: rotate_recovery/RotateRecovery, which gives up where the circle is not free all round.
    """

    Parameters = RotateParameters

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the turn.

        Raises:
            RecoveryError: IMPASSABLE where an obstacle allows no turn at all, TF_ERROR, FAILURE.
        """
        self._turned = 0.0
        yield from self._turn(context, 2.0 * math.pi, 1.0)
        if self._turned < 2.0 * math.pi - self.parameters.yaw_goal_tolerance:
            seen = self._turned
            yield from self._turn(context, 2.0 * math.pi, -1.0)
            if max(seen, self._turned) <= self.parameters.yaw_goal_tolerance:
                raise RecoveryError(
                    RecoveryOutcome.IMPASSABLE, f"'{self.name}' cannot turn either way: the footprint would touch an obstacle"
                )

    def _turn(self, context: RecoveryContext, angle: float, sign: float) -> Iterator[Twist2D]:
        """Yield a turn by `angle` (rad) to the left (`sign` 1) or right (-1), as far as it is free; leave it in _turned."""
        p = self.parameters
        heading = look(context, self.name).pose.theta
        self._turned, rate = 0.0, 0.0
        while True:
            place = look(context, self.name)
            self._turned += sign * angle_between(heading, place.pose.theta)
            heading = place.pose.theta
            left = angle - self._turned
            if left <= p.yaw_goal_tolerance:
                return
            free = self._free_angle(place, left, sign)
            if free < min(left, p.yaw_goal_tolerance):
                return
            limit = speed_to_stop_within(free, p.acc_lim_theta, context.period)
            wanted = min(max(limit, p.min_in_place_vel_theta if free >= left else 0.0), p.max_vel_theta)
            change = p.acc_lim_theta * context.period
            present = sign * measured(lambda: context.velocity, self.name).theta
            base = rate if abs(rate - present) <= 2.0 * change else present
            rate = min(base + change, max(base - change, wanted))
            yield Twist2D(0.0, 0.0, sign * rate)

    def _free_angle(self, place: Place, angle: float, sign: float) -> float:
        count = max(1, math.ceil(angle / self.parameters.sim_granularity))
        headings = place.pose.theta + sign * angle * np.arange(1, count + 1) / count
        poses = np.column_stack((np.full(count, place.pose.x), np.full(count, place.pose.y), headings))
        return angle * place.free_steps(poses) / count
