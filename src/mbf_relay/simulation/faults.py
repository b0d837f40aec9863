"""What can be made to go wrong while the simulation runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class Faults(ParameterSet):
    """Faults on request; by default there are none."""

    lidar_silent: bool = parameter(False, "no scans come")
    lidar_frozen: bool = parameter(False, "scans come in time and repeat the last readings")
    dead_beams: float = parameter(0.0, "share of the beams, side by side, that read 0", minimum=0.0, maximum=1.0)
    dead_beams_start: float = parameter(
        0.0,
        "direction of the first dead beam, counter-clockwise from straight ahead",
        unit="rad",
        minimum=-2.0 * math.pi,
        maximum=2.0 * math.pi,
    )
    short_readings: float = parameter(
        0.0, "share of the beams, anywhere in each scan, that read less than there is, as in sunlight, dust or rain",
        minimum=0.0, maximum=1.0)
    odom_silent: bool = parameter(False, "no odometry comes, neither as a message nor on /tf")
    odom_frozen: bool = parameter(False, "odometry comes in time and repeats the last reading")
    odom_delay: float = parameter(
        0.0, "time by which odometry, on /tf too, comes late", unit="s", minimum=0.0, maximum=10.0
    )
    odom_jump: float = parameter(
        0.0, "how far odometry is off along x of its frame", unit="m", minimum=-1000.0, maximum=1000.0
    )
    slip: float = parameter(
        0.0, "share of their rotation by which the wheels spin without carrying the robot on", minimum=0.0, maximum=1.0
    )
    command_delay: float = parameter(
        0.0, "time by which velocity commands come late", unit="s", minimum=0.0, maximum=10.0
    )


NO_FAULTS = Faults()
