"""The inertial sensor: heading, turn rate and acceleration of the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.simulation.base import Base
from mbf_relay.simulation.parameters import SimulationParameters

GRAVITY = np.array([0.0, 0.0, 9.81])


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
    """Differentiates the body's velocity from one reading to the next."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self._gyro, self._accelerometer, self._rng = parameters.gyro_noise, parameters.accelerometer_noise, rng
        self._last: Optional[np.ndarray] = None
        self._period = 1.0 / parameters.imu_rate if parameters.imu_rate else 0.0

    def reset(self) -> None:
        """Forget the last velocity, so that being set down elsewhere is no blow."""
        self._last = None

    def read(self, base: Base, stamp: float) -> ImuReading:
        """Return a reading at `stamp` (s)."""
        linear, angular = base.velocity()
        change = (linear - self._last) / self._period if self._last is not None else np.zeros(3)
        self._last = linear
        to_body = base.frame().rotation.T
        noise = self._rng.standard_normal(6)
        return ImuReading(
            stamp, base.orientation(), to_body @ angular + self._gyro * noise[:3],
            to_body @ (change + GRAVITY) + self._accelerometer * noise[3:], self._gyro, self._accelerometer,
        )
