"""The inertial sensor: heading, turn rate and acceleration of the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.simulation.base import Motion
from mbf_relay.simulation.frames import Frame, quaternion_product
from mbf_relay.simulation.parameters import SimulationParameters

GRAVITY = 9.81


@dataclass(frozen=True)
class ImuReading:
    """What the sensor says, in its own axes.

    Attributes:
        stamp: Time (s).
        orientation: Of the sensor in the world, quaternion (x, y, z, w).
        turn_rate: Shape (3,) in rad/s.
        acceleration: Shape (3,) in m/s^2; 9.81 upwards at rest.
        turn_rate_deviation, acceleration_deviation: Of each component.
    """

    stamp: float
    orientation: Tuple[float, float, float, float]
    turn_rate: np.ndarray
    acceleration: np.ndarray
    turn_rate_deviation: float
    acceleration_deviation: float


class Imu:
    """Differentiates the velocity of the place where it is from one reading to the next."""

    def __init__(self, parameters: SimulationParameters, in_base: Frame, rng: np.random.Generator) -> None:
        """Mount it.

        Args:
            parameters: Its own are its rate and its noise.
            in_base: Where it is in base_link.
            rng: For its noise.
        """
        self._gyro, self._accelerometer, self._rng = parameters.gyro_noise, parameters.accelerometer_noise, rng
        self._last: Optional[np.ndarray] = None
        self._rate = parameters.imu_rate
        self._mount, self._turned = in_base.quaternion(), in_base.rotation.T
        x, y, z = in_base.position.tolist()
        self._lever = self._turned @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # turn rate x place

    def reset(self) -> None:
        """Forget the last velocity, so that being set down elsewhere is no blow."""
        self._last = None

    def read(self, motion: Motion, stamp: float) -> ImuReading:
        """Return a reading of the base's motion at `stamp` (s).

        What it feels is its speed's change in its own axes, what the axes' turning adds, and what holds it up.
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
