"""What can be set of the guard between navigation and wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List

import numpy as np

from mbf_relay.costmap.outline import footprint_from_radius, notes_on, padded, parse_footprint
from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class VelocityGuardParameters(ParameterSet):
    """Parameters of `velocity_guard`."""

    base_frame: str = parameter(
        "base_link", "frame of the robot, in which velocities and the footprint are given", is_frame=True
    )
    footprint: Any = parameter((), "outline of the robot in its base frame, [[x, y], ...]", unit="m")
    robot_radius: float = parameter(
        0.46, "radius of a round robot, where no footprint is given", unit="m", above=0.0, maximum=10.0
    )
    footprint_padding: float = parameter(0.0, "how much the footprint is widened", unit="m", minimum=0.0, maximum=1.0)
    margin: float = parameter(
        0.01,
        "room the footprint keeps on its way to a stop; what is nearer already may only not come nearer",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    acc_lim_x: float = parameter(1.0, "how fast the robot surely slows down", unit="m/s^2", above=0.0)
    wheel_separation: float = parameter(
        0.0, "distance between the wheels of a differential drive, whose rims slow down by acc_lim_x; 0 where that is "
        "not known, and speed and turn brake each by itself", unit="m", minimum=0.0, maximum=10.0, clamped=False,
    )
    wheelbase: float = parameter(
        0.0, "distance from the rear axle to the front one of a car whose velocities come, and are taken, with the "
        "steering angle (rad) for a rate; below 0 where it steers with its rear wheels, 0 for rates", unit="m",
    )
    acc_lim_theta: float = parameter(
        6.0, "how fast it surely stops turning, where no wheels are known", unit="rad/s^2", above=0.0
    )
    reaction_time: float = parameter(
        0.2,
        "time a velocity goes on before a better one takes its place: a scan's period or so",
        unit="s",
        minimum=0.0,
        maximum=5.0,
    )
    input_timeout: float = parameter(
        0.5, "a velocity older than this is a stop: its sender is gone or hangs", unit="s", above=0.0, maximum=10.0
    )
    scan_timeout: float = parameter(
        0.6, "without a scan younger than this the robot stands", unit="s", above=0.0, maximum=10.0
    )
    blind_sector: float = parameter(
        0.2, "neighbouring beams without a valid reading are, from this angle on, taken for something that touches "
        "the robot there; 0 where its driver sends 0 for what is far", unit="rad", minimum=0.0, maximum=7.0,
    )
    unseen_speed: float = parameter(
        0.1, "top speed in a direction in which no beam looks, or none past the footprint", unit="m/s", minimum=0.0
    )

    def check(self) -> None:
        """Raise ValueError where the footprint is none."""
        parse_footprint(self.footprint)

    def read_as(self) -> List[str]:
        """Tell of a footprint that crosses itself."""
        return notes_on(self.footprint)

    def outline(self) -> np.ndarray:
        """Return the padded outline, shape (K, 2) in metres."""
        corners = parse_footprint(self.footprint)
        return padded(corners if len(corners) else footprint_from_radius(self.robot_radius), self.footprint_padding)
