"""Cars whose driver takes the angle of the front wheels where others take a rate of turning."""

from __future__ import annotations

import math
from typing import NamedTuple

from mbf_relay.geometry import Twist2D


class Steering(NamedTuple):
    """A car's steering, by the model of a bicycle.

    Attributes:
        wheelbase: Distance (m) from the rear axle to the front one; below 0 for a car that steers with its rear wheels.
        least_radius: Smallest circle (m) its rear axle drives; 0 where that is not known.
    """

    wheelbase: float
    least_radius: float = 0.0

    def steered(self, velocity: Twist2D) -> Twist2D:
        """Return a velocity with the steering angle (rad) in place of its rate; 0 for a car that stands.

        As teb_local_planner has it with cmd_angle_instead_rotvel: a rate too high for its speed is the smallest circle.
        """
        if velocity.x == 0.0 or velocity.theta == 0.0:
            return velocity._replace(theta=0.0)
        radius = velocity.x / velocity.theta
        radius = math.copysign(max(abs(radius), self.least_radius), radius)
        return velocity._replace(theta=math.atan(self.wheelbase / radius))

    def turning(self, command: Twist2D) -> Twist2D:
        """Return what a command with a steering angle comes to as a velocity: the reverse of `steered`.

        One that is not finite stays so; of an infinite angle there is no tangent.
        """
        if not command.is_finite():
            return command
        return command._replace(theta=command.x * math.tan(command.theta) / self.wheelbase)
