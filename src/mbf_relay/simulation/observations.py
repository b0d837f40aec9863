"""The readings of one simulation step."""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

from mbf_relay.scan import LaserScan
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.drive import Odometry
from mbf_relay.simulation.imu import ImuReading


class JointReading(NamedTuple):
    """State of the joints, the driven wheels' first: time (s), angles (rad), speeds (rad/s), and names."""

    stamp: float
    positions: Tuple[float, ...]
    velocities: Tuple[float, ...]
    names: Tuple[str, ...]


class Observations(NamedTuple):
    """Readings, None where a sensor was not due or is silent, and the robot's contacts."""

    scan: Optional[LaserScan] = None
    odometry: Optional[Odometry] = None
    imu: Optional[ImuReading] = None
    joints: Optional[JointReading] = None
    contacts: Tuple[Contact, ...] = ()


NOTHING = Observations()
