"""Conversion between rotational velocity and steering angle, for cars whose base driver expects the angle."""

from __future__ import annotations

import math
from typing import NamedTuple

from mbf_relay.geometry import Twist2D


class Steering(NamedTuple):
    """A car's steering by the bicycle model.

    Attributes:
        wheelbase: Distance (m) from the rear axle to the front one; below 0 for a car that steers with its rear wheels.
        least_radius: Minimum turning radius (m) of the rear axle; 0 if unknown.
    """

    wheelbase: float
    least_radius: float = 0.0

    def steered(self, velocity: Twist2D) -> Twist2D:
        """Return a velocity with the steering angle (rad) in place of the rotational velocity; 0 at standstill.

        Like teb_local_planner with cmd_angle_instead_rotvel: curves tighter than `least_radius` become that radius.
        """
        if velocity.x == 0.0 or velocity.theta == 0.0:
            return velocity._replace(theta=0.0)
        radius = velocity.x / velocity.theta
        radius = math.copysign(max(abs(radius), self.least_radius), radius)
        return velocity._replace(theta=math.atan(self.wheelbase / radius))

    def turning(self, command: Twist2D) -> Twist2D:
        """Return the velocity of a command that has a steering angle (rad) in `theta`; the inverse of `steered`.

        A command that is not finite is returned as it is, because math.tan raises on an infinite angle.
        """
        if not command.is_finite():
            return command
        return command._replace(theta=command.x * math.tan(command.theta) / self.wheelbase)
