"""Drives straight back a little."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator

import numpy as np

from mbf_relay.control.trajectories import speed_to_stop_within
from mbf_relay.geometry import Twist2D
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.recovery.maneuver import CheckedPose, checked_pose, measured
from mbf_relay.recovery.recovery import Recovery, RecoveryContext

LEAST = 2.0  # least distance, in steps of the footprint checker, after which a drive cut short counts as done


@dataclass(frozen=True)
class BackUpParameters(ParameterSet):
    """Parameters of BackUp."""

    distance: float = parameter(0.15, "how far to drive back", "m", above=0.0)
    speed: float = parameter(0.1, "highest speed", "m/s", above=0.0)
    acceleration: float = parameter(1.0, "acceleration and deceleration", "m/s^2", above=0.0)
    timeout: float = parameter(10.0, "time after which it gives up", "s", above=0.0)


class BackUp(Recovery):
    """Drives straight back as far as the local costmap is free, which is checked at each step."""

    Parameters = BackUpParameters
    parameters: BackUpParameters
    leaves_place = True

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the drive.

        Raises:
            RecoveryError: IMPASSABLE where it is not free behind, PAT_EXCEEDED where the robot does not move, TF_ERROR,
                FAILURE.
        """
        p = self.parameters
        start, tried, speed = checked_pose(context, self.name).pose, 0.0, 0.0
        while True:
            place = checked_pose(context, self.name)
            moved = -place.pose.relative_to(start).x
            left = p.distance - moved
            step = place.checker.step
            if left <= 0.5 * step:
                return
            free = self._free_distance(place, left)
            if free < min(LEAST * step, left):
                if moved >= LEAST * step:
                    return
                raise RecoveryError(
                    RecoveryOutcome.IMPASSABLE,
                    f"'{self.name}' cannot drive back: an obstacle is {free:.2f} m behind the robot",
                )
            if tried > p.timeout:
                if moved >= LEAST * step:
                    return
                raise RecoveryError(
                    RecoveryOutcome.PAT_EXCEEDED,
                    f"'{self.name}' moved {moved:.2f} m of {p.distance:.2f} m within {p.timeout:.1f} s; see whether "
                    "the wheels are free",
                )
            change = p.acceleration * context.period
            present = -measured(lambda: context.velocity, self.name).x
            base = speed if abs(speed - present) <= 2.0 * change else max(0.0, present)
            wanted = min(p.speed, speed_to_stop_within(free, p.acceleration, context.period))
            speed = min(base + change, max(base - change, wanted))
            yield Twist2D(-speed, 0.0, 0.0)
            tried += context.period  # steps are counted, as the clock goes on while the server is paused

    @staticmethod
    def _free_distance(place: CheckedPose, distance: float) -> float:
        count = max(1, math.ceil(distance / place.checker.step))
        back = distance * np.arange(1, count + 1) / count
        poses = place.pose.transform_poses(np.column_stack((-back, np.zeros(count), np.zeros(count))))
        return distance * place.free_steps(poses) / count
