"""The inertial sensor: heading, turn rate and acceleration of the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.simulation.base import Motion
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
    """Differentiates the body's velocity from one reading to the next."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self._gyro, self._accelerometer, self._rng = parameters.gyro_noise, parameters.accelerometer_noise, rng
        self._last: Optional[Motion] = None
        self._rate = parameters.imu_rate

    def reset(self) -> None:
        """Forget the last velocity, so that being set down elsewhere is no blow."""
        self._last = None

    def read(self, motion: Motion, stamp: float) -> ImuReading:
        """Return a reading of the base's motion at `stamp` (s).

        What the body feels is its speed's change in its own axes, what the axes' turning adds, and what holds it up.
        """
        last = self._last or motion
        self._last = motion
        (vx, vy, vz), (wx, wy, wz), up = motion.velocity, motion.turn_rate, motion.up
        change = [(now - before) * self._rate for now, before in zip(motion.velocity, last.velocity)]
        felt = (
            change[0] + wy * vz - wz * vy + GRAVITY * up[0], change[1] + wz * vx - wx * vz + GRAVITY * up[1],
            change[2] + wx * vy - wy * vx + GRAVITY * up[2],
        )
        noise = self._rng.standard_normal(6)
        return ImuReading(
            stamp,
            motion.orientation,
            motion.turn_rate + self._gyro * noise[:3],
            felt + self._accelerometer * noise[3:],
            self._gyro,
            self._accelerometer,
        )
