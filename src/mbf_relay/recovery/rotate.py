"""Turns a full circle, so that the sensors see all around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Iterator, Tuple

import numpy as np

from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.geometry import Twist2D, angle_between
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome
from mbf_relay.parameters import ParameterSet, parameter, without_effect
from mbf_relay.recovery.maneuver import CheckedPose, checked_pose, measured
from mbf_relay.recovery.recovery import Recovery, RecoveryContext

FULL = 2.0 * math.pi


@dataclass(frozen=True)
class RotateParameters(ParameterSet):
    """Parameters of Rotate, by rotate_recovery's names; missing ones are read from TrajectoryPlannerROS's group."""

    sim_granularity: float = parameter(
        0.017, "angle between the headings that are checked for collision", "rad", above=0.0)
    frequency: float = without_effect(20.0, "velocities are sent at the server's rate", "Hz", above=0.0)
    acc_lim_theta: float = parameter(
        3.2, "rotational acceleration limit", "rad/s^2", above=0.0, aliases=("acc_lim_th",))
    max_vel_theta: float = parameter(
        1.0, "highest rotational speed", "rad/s", above=0.0, aliases=("max_rotational_vel",))
    min_in_place_vel_theta: float = parameter(
        0.4, "lowest rotational speed, except to start and to brake", "rad/s", minimum=0.0,
        aliases=("min_in_place_rotational_vel",))
    yaw_goal_tolerance: float = parameter(
        0.1, "angle to the first heading at which the turn counts as complete", "rad", above=0.0)

    ORDERED: ClassVar[Tuple[Tuple[str, str], ...]] = (("min_in_place_vel_theta", "max_vel_theta"),)


class Rotate(Recovery):
    """Turns a full circle to the left.

    Before each step the footprint is checked along the rest of the circle on the current costmap. Unless all of it is
    free, the robot does not turn: after a part of a turn it would stand across a narrow place.

    Source: rotate_recovery/RotateRecovery.
    """

    Parameters = RotateParameters
    parameters: RotateParameters
    only_looks_round = True
    reads_also = "TrajectoryPlannerROS"

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the turn.

        Raises:
            RecoveryError: IMPASSABLE where an obstacle is in the way, TF_ERROR, FAILURE.
        """
        p = self.parameters
        turned, rate, heading = 0.0, 0.0, checked_pose(context, self.name).pose.theta
        while True:
            place = checked_pose(context, self.name)
            turned += angle_between(heading, place.pose.theta)
            heading = place.pose.theta
            left = FULL - turned
            if left <= p.yaw_goal_tolerance:
                return
            free = self._free_angle(place, left)
            if free < left - 1e-9:
                raise RecoveryError(
                    RecoveryOutcome.IMPASSABLE,
                    f"'{self.name}' cannot turn on: after {math.degrees(free):.0f} degrees more the footprint would "
                    "touch an obstacle",
                )
            rate = self._rate(context, left, rate)
            yield Twist2D(0.0, 0.0, rate)

    def _rate(self, context: RecoveryContext, left: float, last: float) -> float:
        """Return the rotational speed (rad/s) for the next step.

        Args:
            context: For period and velocity.
            left: Angle still to turn (rad).
            last: Speed commanded last (rad/s).
        """
        p = self.parameters
        change = p.acc_lim_theta * context.period
        wanted = max(speed_to_stop_within(left, p.acc_lim_theta, context.period), p.min_in_place_vel_theta)
        present = measured(lambda: context.velocity, self.name).theta
        base = last if abs(last - present) <= 2.0 * change else present
        return min(base + change, max(base - change, min(wanted, p.max_vel_theta)))

    def _free_angle(self, place: CheckedPose, angle: float) -> float:
        count = max(1, math.ceil(angle / self.parameters.sim_granularity))
        headings = place.pose.theta + angle * np.arange(1, count + 1) / count
        poses = np.column_stack((np.full(count, place.pose.x), np.full(count, place.pose.y), headings))
        return angle * place.free_steps(poses) / count
