"""From a velocity command to wheel speeds, and from wheel rotation back to odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, normalize_angle
from mbf_relay.simulation import burger
from mbf_relay.simulation.parameters import SimulationParameters


@dataclass(frozen=True)
class Odometry:
    """What the robot makes of its wheels' rotation.

    Attributes:
        stamp: Time (s).
        pose: Of base_footprint in odom, which is where the robot was set down first.
        velocity: In the body's own axes.
        pose_variance: Of x, y (m^2) and heading (rad^2); it grows with the way.
        velocity_variance: Of the speed (m^2/s^2) and the turn rate (rad^2/s^2).
    """

    stamp: float
    pose: Pose2D
    velocity: Twist2D
    pose_variance: Tuple[float, float, float]
    velocity_variance: Tuple[float, float]


def limit_command(command: Twist2D, parameters: SimulationParameters) -> Twist2D:
    """Return the command cut to the robot's top speeds; a differential drive cannot go sideways."""
    speed = min(parameters.max_speed, max(-parameters.max_speed, command.x))
    turn = min(parameters.max_turn_rate, max(-parameters.max_turn_rate, command.theta))
    return Twist2D(speed, 0.0, turn)


def wheel_speeds(velocity: Twist2D) -> Tuple[float, float]:
    """Return the left and right wheel's speed (rad/s) that drives the robot at `velocity`."""
    half_track = burger.WHEEL_SEPARATION / 2.0
    return (
        (velocity.x - velocity.theta * half_track) / burger.WHEEL_RADIUS,
        (velocity.x + velocity.theta * half_track) / burger.WHEEL_RADIUS,
    )


def approach(current: float, target: float, change: float) -> float:
    """Return `current` moved towards `target` by at most `change`."""
    return min(target, current + change) if target > current else max(target, current - change)


class Odometer:
    """Adds up wheel rotation, with the errors asked for.

    Each reading moves the pose along the arc between the two wheel angles, taken at the arc's middle heading.
    """

    def __init__(self, noise: float, bias: Tuple[float, float], rng: np.random.Generator) -> None:
        """Start at the origin.

        Args:
            noise: Deviation (m) of a wheel's way after one metre.
            bias: Error of the left and right wheel's way as a share of it.
            rng: For the noise.
        """
        self._noise, self._bias, self._rng = noise, bias, rng
        self.restart()

    def restart(self) -> None:
        """Begin again at the origin."""
        self.pose = IDENTITY
        self.velocity = STOP
        self._variance_xy = 0.0
        self._variance_theta = 0.0

    def advance(self, left: float, right: float, duration: float) -> None:
        """Add what the wheels turned (rad) during `duration` (s)."""
        left = self._measured(left * burger.WHEEL_RADIUS, self._bias[0])
        right = self._measured(right * burger.WHEEL_RADIUS, self._bias[1])
        way, turn = (left + right) / 2.0, (right - left) / burger.WHEEL_SEPARATION
        middle = self.pose.theta + turn / 2.0
        self.pose = Pose2D(
            self.pose.x + way * math.cos(middle), self.pose.y + way * math.sin(middle),
            normalize_angle(self.pose.theta + turn),
        )
        self.velocity = Twist2D(way / duration, 0.0, turn / duration)
        wheels = self._noise ** 2 * (abs(left) + abs(right))
        self._variance_theta += wheels / burger.WHEEL_SEPARATION ** 2
        self._variance_xy += wheels / 4.0 + way ** 2 * self._variance_theta

    def reading(self, stamp: float) -> Odometry:
        """Return the odometry at `stamp` (s)."""
        xy, theta = 1e-6 + self._variance_xy, 1e-6 + self._variance_theta
        return Odometry(stamp, self.pose, self.velocity, (xy, xy, theta), (1e-4, 1e-3))

    def _measured(self, way: float, bias: float) -> float:
        if self._noise > 0.0 and way != 0.0:
            way += self._noise * math.sqrt(abs(way)) * self._rng.standard_normal()
        return way * (1.0 + bias)
