"""Parameters of the velocity guard, between navigation and wheels."""

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
        "base_link", "frame of the robot, in which velocities and the footprint are given", is_frame=True)
    footprint: Any = parameter(
        (), "outline of the robot in its base frame, [[x, y], ...]; empty for a circle of robot_radius", unit="m")
    robot_radius: float = parameter(
        0.46, "radius of a round robot, used if no footprint is given", unit="m", above=0.0, maximum=10.0)
    footprint_padding: float = parameter(
        0.0, "how far the footprint is extended on every side", unit="m", minimum=0.0, maximum=1.0)
    margin: float = parameter(
        0.01, "clearance to keep while stopping; from an obstacle that is nearer already the robot may only move away",
        unit="m", minimum=0.0, maximum=1.0)
    acc_lim_x: float = parameter(
        1.0, "deceleration the robot can always reach when it brakes; too high a value stops it too late", unit="m/s^2",
        above=0.0)
    wheel_separation: float = parameter(
        0.0, "distance between the wheels of a differential drive, whose rims then brake by acc_lim_x; 0 if unknown: "
        "speed and turn then brake independently", unit="m", minimum=0.0, maximum=10.0, clamped=False)
    wheelbase: float = parameter(
        0.0, "distance from the rear to the front axle of a car that is commanded with a steering angle (rad) in place "
        "of a rotational velocity; below 0 if it steers with its rear wheels, 0 for rotational velocities", unit="m")
    acc_lim_theta: float = parameter(
        6.0, "rotational deceleration the robot can always reach, used if wheel_separation is 0", unit="rad/s^2",
        above=0.0)
    reaction_time: float = parameter(
        0.2, "time for which a velocity goes on before the next one replaces it, about a scan's period", unit="s",
        minimum=0.0, maximum=5.0)
    input_timeout: float = parameter(
        0.5, "age of the last velocity command above which the robot is stopped: its sender has ended or hangs",
        unit="s", above=0.0, maximum=10.0)
    scan_timeout: float = parameter(
        0.6, "age of the last scan above which the robot is stopped", unit="s", above=0.0, maximum=10.0)
    blind_sector: float = parameter(
        0.2, "angle of neighbouring beams without a valid reading from which on an obstacle is assumed there; 0 for a "
        "lidar that sends 0 where everything is out of range", unit="rad", minimum=0.0, maximum=7.0)
    unseen_speed: float = parameter(
        0.1, "highest speed in a direction the lidar does not look in, or in which it does not see past the footprint",
        unit="m/s", minimum=0.0)

    def check(self) -> None:
        """Raise ValueError for an invalid footprint."""
        parse_footprint(self.footprint)

    def read_as(self) -> List[str]:
        """Return a note on a footprint that crosses itself."""
        return notes_on(self.footprint)

    def outline(self) -> np.ndarray:
        """Return the padded outline, shape (K, 2) in metres."""
        corners = parse_footprint(self.footprint)
        return padded(corners if len(corners) else footprint_from_radius(self.robot_radius), self.footprint_padding)
