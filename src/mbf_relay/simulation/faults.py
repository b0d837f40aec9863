"""Faults that can be injected while the simulation runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class Faults(ParameterSet):
    """Faults of the simulator that can be set while it runs; by default there are none."""

    lidar_silent: bool = parameter(False, "no scans are published")
    lidar_frozen: bool = parameter(False, "scans are published on time with the last readings repeated")
    dead_beams: float = parameter(
        0.0, "share of a full turn's beams, side by side, that read 0 where they are in view", minimum=0.0, maximum=1.0)
    dead_beams_start: float = parameter(
        0.0,
        "direction of the first dead beam, counter-clockwise from straight ahead",
        unit="rad",
        minimum=-2.0 * math.pi,
        maximum=2.0 * math.pi,
    )
    short_readings: float = parameter(
        0.0, "share of random beams in each scan that read too short, as in sunlight, dust or rain", minimum=0.0,
        maximum=1.0)
    odom_silent: bool = parameter(False, "no odometry is published, neither as a message nor on /tf")
    odom_frozen: bool = parameter(False, "odometry is published on time with the last reading repeated")
    odom_delay: float = parameter(0.0, "delay of odometry, also on /tf", unit="s", minimum=0.0, maximum=10.0)
    odom_jump: float = parameter(
        0.0, "offset added to odometry along x of its frame", unit="m", minimum=-1000.0, maximum=1000.0)
    slip: float = parameter(0.0, "share of the wheels' rotation that does not move the robot", minimum=0.0, maximum=1.0)
    command_delay: float = parameter(0.0, "delay of velocity commands", unit="s", minimum=0.0, maximum=10.0)


NO_FAULTS = Faults()
