"""Kinematics of a differential drive: wheel speeds from a velocity command, and odometry from wheel rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, normalize_angle
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import OMNIDIRECTIONAL, Wheels

LEAST_COVARIANCE = (1e-6, 0.0, 1e-6, 0.0, 0.0, 1e-6)
"""Initial covariance of the pose: xx, xy, yy, x-theta, y-theta, theta-theta (m, rad)."""


@dataclass(frozen=True, eq=False)
class Odometry:
    """A reading of wheel odometry.

    Attributes:
        stamp: Time (s).
        pose: Pose of base_footprint in odom, whose origin is the robot's start.
        velocity: Velocity in the body's own axes.
        pose_covariance: Covariance of x, y and heading (m, rad), shape (3, 3); it grows with the distance driven.
        velocity_variance: Variances of the velocity along x and y (m^2/s^2) and about z (rad^2/s^2).
    """

    stamp: float
    pose: Pose2D
    velocity: Twist2D
    pose_covariance: np.ndarray
    velocity_variance: Tuple[float, float, float]


def limit_command(command: Twist2D, parameters: SimulationParameters, drive: str) -> Twist2D:
    """Return the command clamped to the robot's top speeds; without y for any but an omnidirectional drive.

    An omnidirectional drive's linear velocity keeps its direction.
    """
    turn = min(parameters.max_turn_rate, max(-parameters.max_turn_rate, command.theta))
    if drive == OMNIDIRECTIONAL:
        share = min(1.0, parameters.max_speed / max(math.hypot(command.x, command.y), 1e-12))
        return Twist2D(share * command.x, share * command.y, turn)
    return Twist2D(min(parameters.max_speed, max(-parameters.max_speed, command.x)), 0.0, turn)


def wheel_speeds(velocity: Twist2D, wheels: Wheels) -> Tuple[float, float]:
    """Return the left and the right wheel's speed (rad/s) for the robot's `velocity` (body frame)."""
    half_track = wheels.separation / 2.0
    return (
        (velocity.x - velocity.theta * half_track) / wheels.radius,
        (velocity.x + velocity.theta * half_track) / wheels.radius,
    )


def approach(current: float, target: float, change: float) -> float:
    """Return `current` moved towards `target` by at most `change`."""
    return min(target, current + change) if target > current else max(target, current - change)


class Odometer:
    """Integrates wheel rotation to a pose, with simulated errors.

    Each reading moves the pose along the chord at the mean heading. The covariance is propagated to first order from
    independent errors of the wheels.
    """

    def __init__(self, wheels: Wheels, noise: float, bias: Tuple[float, float], rng: np.random.Generator) -> None:
        """Start at the origin.

        Args:
            wheels: The robot's wheels.
            noise: Standard deviation (m) of a wheel's distance after one metre.
            bias: Relative error of the left and the right wheel's distance.
            rng: Generator of the noise.
        """
        self._radius, self._separation = wheels.radius, wheels.separation
        self._noise, self._bias, self._rng = noise, bias, rng
        self.restart()

    def restart(self) -> None:
        """Reset pose and covariance to the origin."""
        self.pose = IDENTITY
        self.velocity = STOP
        self._covariance = LEAST_COVARIANCE

    def advance(self, turned: Sequence[float], duration: float) -> None:
        """Add rotations (rad) of the left and the right wheel during `duration` (s)."""
        left = self._measured(turned[0] * self._radius, self._bias[0])
        right = self._measured(turned[1] * self._radius, self._bias[1])
        way, turn = (left + right) / 2.0, (right - left) / self._separation
        middle = self.pose.theta + turn / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        self.pose = Pose2D(
            self.pose.x + way * cos, self.pose.y + way * sin, normalize_angle(self.pose.theta + turn)
        )
        self.velocity = Twist2D(way / duration, 0.0, turn / duration)
        if way or turn:
            self._spread(way, cos, sin, self._noise ** 2 * abs(left), self._noise ** 2 * abs(right))

    def reading(self, stamp: float) -> Odometry:
        """Return the odometry at `stamp` (s)."""
        xx, xy, yy, xt, yt, tt = self._covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        return Odometry(stamp, self.pose, self.velocity, covariance, (1e-4, 1e-9, 1e-3))

    def _spread(self, way: float, cos: float, sin: float, left: float, right: float) -> None:
        """Propagate the covariance over one reading: P becomes F P F' + G Q G'.

        F is the Jacobian of the motion by the pose, G that by distance and turn. Written out for the symmetric matrix,
        as NumPy is slow on 3 x 3.

        Args:
            way: Distance of the middle between the wheels (m).
            cos, sin: Of the mean heading.
            left, right: Variances of the wheels' distances (m^2).
        """
        xx, xy, yy, xt, yt, tt = self._covariance
        a, b = -way * sin, way * cos
        ways, turns = (left + right) / 4.0, (left + right) / self._separation ** 2
        both = (right - left) / (2.0 * self._separation)
        self._covariance = (
            xx + 2.0 * a * xt + a * a * tt + cos * cos * ways,
            xy + a * yt + b * xt + a * b * tt + cos * sin * ways,
            yy + 2.0 * b * yt + b * b * tt + sin * sin * ways,
            xt + a * tt + cos * both,
            yt + b * tt + sin * both,
            tt + turns,
        )

    def _measured(self, way: float, bias: float) -> float:
        if self._noise > 0.0 and way != 0.0:
            way += self._noise * math.sqrt(abs(way)) * self._rng.standard_normal()
        return way * (1.0 + bias)
