"""The inertial measurement unit: orientation, angular velocity and acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.simulation.base import Motion
from mbf_relay.simulation.frames import Frame, quaternion_product
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import GRAVITY


@dataclass(frozen=True)
class ImuReading:
    """A reading, in the sensor's own axes.

    Attributes:
        stamp: Time (s).
        orientation: Orientation of the sensor in the world, quaternion (x, y, z, w), without noise.
        turn_rate: Angular velocity, shape (3,) in rad/s.
        acceleration: Specific force, shape (3,) in m/s^2; 9.81 upwards at rest.
        turn_rate_deviation, acceleration_deviation: Standard deviation of each component's noise.
    """

    stamp: float
    orientation: Tuple[float, float, float, float]
    turn_rate: np.ndarray
    acceleration: np.ndarray
    turn_rate_deviation: float
    acceleration_deviation: float


class Imu:
    """Simulates readings by differentiating the velocity of its mounting point between readings."""

    def __init__(self, parameters: SimulationParameters, in_base: Frame, rng: np.random.Generator) -> None:
        """Mount the sensor.

        Args:
            parameters: For its rate and noise.
            in_base: Its pose in base_link.
            rng: Generator of its noise.
        """
        self._gyro, self._accelerometer, self._rng = parameters.gyro_noise, parameters.accelerometer_noise, rng
        self._last: Optional[np.ndarray] = None
        self._rate = parameters.imu_rate
        self._mount, self._turned = in_base.quaternion(), in_base.rotation.T
        x, y, z = in_base.position.tolist()
        self._lever = self._turned @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # turn rate x position

    def reset(self) -> None:
        """Forget the last velocity, so that a move to another pose is no acceleration."""
        self._last = None

    def read(self, motion: Motion, stamp: float) -> ImuReading:
        """Return a reading of the base's motion at `stamp` (s).

        The specific force is the derivative of the velocity in the sensor's axes, plus turn rate x velocity, plus
        gravity's reaction.
        """
        velocity = self._turned @ motion.velocity + self._lever @ motion.turn_rate
        turn_rate = self._turned @ motion.turn_rate
        last, self._last = velocity if self._last is None else self._last, velocity
        (vx, vy, vz), (wx, wy, wz) = velocity.tolist(), turn_rate.tolist()
        felt = (velocity - last) * self._rate + GRAVITY * (self._turned @ motion.up)
        felt += (wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx)
        noise = self._rng.standard_normal(6)
        return ImuReading(
            stamp,
            quaternion_product(motion.orientation, self._mount),
            turn_rate + self._gyro * noise[:3],
            felt + self._accelerometer * noise[3:],
            self._gyro,
            self._accelerometer,
        )
