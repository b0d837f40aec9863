"""Kinematics and odometry of four mecanum wheels."""

from __future__ import annotations

import math
from typing import Sequence, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, normalize_angle
from mbf_relay.simulation.drive import LEAST_COVARIANCE, Odometry
from mbf_relay.simulation.robot import Wheels


def mecanum_matrix(wheels: Wheels) -> np.ndarray:
    """Return the matrix that maps a velocity (x, y, theta) to the wheels' speeds (rad/s), shape (4, 3).

    The wheels are front left, front right, rear left, rear right, with rollers at 45 degrees; R. Siegwart,
    I. Nourbakhsh, "Introduction to Autonomous Mobile Robots", 2004, section 3.2.
    """
    arm = (wheels.separation + wheels.base) / 2.0
    rows = [(1.0, -1.0, -arm), (1.0, 1.0, arm), (1.0, 1.0, -arm), (1.0, -1.0, arm)]
    return np.array(rows) / wheels.radius


class MecanumOdometer:
    """Integrates the rotation of four mecanum wheels to a pose, with simulated errors, as `Odometer` does for two."""

    def __init__(self, wheels: Wheels, noise: float, bias: Tuple[float, float], rng: np.random.Generator) -> None:
        """Start at the origin.

        Args:
            wheels: The robot's wheels.
            noise: Standard deviation (m) of a wheel's distance after one metre.
            bias: Relative error of the left and the right wheels' distances.
            rng: Generator of the noise.
        """
        self._radius, self._noise, self._rng = wheels.radius, noise, rng
        self._motion_of = np.linalg.pinv(mecanum_matrix(wheels)) / wheels.radius  # from distances (m), least squares
        self._bias = 1.0 + np.array([bias[0], bias[1], bias[0], bias[1]])
        self.restart()

    def restart(self) -> None:
        """Reset pose and covariance to the origin."""
        self.pose, self.velocity = IDENTITY, STOP
        xx, xy, yy, xt, yt, tt = LEAST_COVARIANCE
        self._covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])

    def advance(self, turned: Sequence[float], duration: float) -> None:
        """Add the four wheels' rotations (rad) during `duration` (s)."""
        ways = np.array(turned) * self._radius
        deviations = self._noise * np.sqrt(np.abs(ways))
        if self._noise > 0.0:
            ways = ways + deviations * self._rng.standard_normal(4)
        x, y, turn = (float(part) for part in self._motion_of @ (ways * self._bias))
        middle = self.pose.theta + turn / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        self.pose = Pose2D(
            self.pose.x + cos * x - sin * y, self.pose.y + sin * x + cos * y, normalize_angle(self.pose.theta + turn)
        )
        self.velocity = Twist2D(x / duration, y / duration, turn / duration)
        carried = np.eye(3)
        carried[:2, 2] = -sin * x - cos * y, cos * x - sin * y
        spread = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ self._motion_of
        self._covariance = carried @ self._covariance @ carried.T + (spread * deviations ** 2) @ spread.T

    def reading(self, stamp: float) -> Odometry:
        """Return the odometry at `stamp` (s)."""
        return Odometry(stamp, self.pose, self.velocity, self._covariance, (1e-4, 1e-4, 1e-3))
