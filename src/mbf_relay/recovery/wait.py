"""Waits, as an obstacle may move away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.recovery.recovery import Recovery, RecoveryContext
from mbf_relay.timing import Stopwatch


@dataclass(frozen=True)
class WaitParameters(ParameterSet):
    """Parameters of Wait."""

    duration: float = parameter(2.0, "how long to stand", "s", minimum=0.0)


class Wait(Recovery):
    """Commands stops for a time."""

    Parameters = WaitParameters
    parameters: WaitParameters

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield stops until the time is over."""
        waited = Stopwatch(context.now)
        while waited.elapsed(context.now) < self.parameters.duration:
            yield STOP
