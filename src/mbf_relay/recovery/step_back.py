"""Replaces recovery behaviours of other packages for cars, which step back and then steer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator, List, Mapping

from mbf_relay.geometry import Twist2D
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.recovery.back_up import BackUp, BackUpParameters
from mbf_relay.recovery.recovery import Recovery, RecoveryContext


@dataclass(frozen=True)
class StepBackParameters(ParameterSet):
    """The parameters of step_back_and_max_steer_recovery and stepback_and_steerturn_recovery that have an effect."""

    step_back_length: float = parameter(1.0, "how far to drive back", "m", above=0.0)
    linear_vel_back: float = parameter(-0.3, "velocity of driving back; its sign does not matter", "m/s")
    step_back_timeout: float = parameter(10.0, "time after which it gives up", "s", above=0.0)

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return nothing; see `stands_in` of the behaviour."""
        return []

    def check(self) -> None:
        """Raise ValueError for a speed of zero."""
        if self.linear_vel_back == 0.0:
            raise ValueError("parameter linear_vel_back is 0.0; it must not be")


class StepBack(Recovery):
    """Drives straight back, which is the first part of the behaviours it replaces."""

    Parameters = StepBackParameters
    parameters: StepBackParameters
    leaves_place = True
    stands_in = "the robot drives straight back as it would, and does not steer there"

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the drive; errors as for BackUp."""
        p = self.parameters
        yield from BackUp(self.name, BackUpParameters(
            distance=p.step_back_length, speed=abs(p.linear_vel_back), timeout=p.step_back_timeout)).run(context)
