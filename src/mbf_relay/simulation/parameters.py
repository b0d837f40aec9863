"""Parameters of the simulated robot, its sensors and the physics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Mapping, Tuple

import numpy as np

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.simulation.robot_file import load_robot

RATES = ("scan_rate", "odom_rate", "imu_rate", "joint_state_rate")
"""Names of the sensors' rates, which must divide physics_rate."""


@dataclass(frozen=True)
class SimulationParameters(ParameterSet):
    """Parameters of `Simulation`; the defaults are those of a TurtleBot3 burger with an LDS-01 lidar.

    Values that the user does not set are those of the robot's file, else these defaults.
    """

    robot: str = parameter(
        "burger", "name of a file in config/robot without its ending, or path of a robot's YAML or URDF file")
    physics_rate: int = parameter(
        120, "physics steps per second of simulated time", unit="Hz", minimum=20, maximum=2000
    )
    start_time: float = parameter(1.0, "time on the clock at start", unit="s", above=0.0)
    solver_iterations: int = parameter(40, "iterations of the contact solver per step", minimum=5, maximum=500)

    max_speed: float = parameter(0.22, "highest speed forward and backward", unit="m/s", above=0.0)
    max_turn_rate: float = parameter(2.84, "highest rotational speed", unit="rad/s", above=0.0)
    wheel_acceleration: float = parameter(1.0, "highest acceleration at the rim of a wheel", unit="m/s^2", above=0.0)
    wheel_torque: float = parameter(0.5, "highest torque of a wheel's motor", unit="N m", above=0.0)
    wheel_friction: float = parameter(1.0, "friction coefficient of the tyres on the ground", above=0.0, maximum=10.0)
    wheel_slip: float = parameter(
        0.0, "share of the wheels' rotation that does not move the robot", minimum=0.0, maximum=1.0)
    cmd_vel_timeout: float = parameter(
        0.5, "age of the velocity command above which the robot stops; 0 for no limit", unit="s", minimum=0.0)

    odom_rate: float = parameter(30.0, "rate of odometry; 0 for none", unit="Hz", minimum=0.0)
    odom_noise: float = parameter(
        0.001, "standard deviation of a wheel's measured distance after one metre; grows with the square root of the "
        "distance", unit="m", minimum=0.0)
    odom_bias: Tuple[float, float] = parameter(
        (0.0, 0.0), "relative error of the distance measured by the left and the right wheel; 0.1 reads 10 % too far",
        minimum=-0.5, maximum=0.5)
    joint_state_rate: float = parameter(30.0, "rate of joint states; 0 for none", unit="Hz", minimum=0.0)

    imu_rate: float = parameter(60.0, "rate of the inertial sensor; 0 for none", unit="Hz", minimum=0.0)
    gyro_noise: float = parameter(0.002, "standard deviation of the rotational velocity", unit="rad/s", minimum=0.0)
    accelerometer_noise: float = parameter(0.017, "standard deviation of the acceleration", unit="m/s^2", minimum=0.0)

    scan_rate: float = parameter(5.0, "rate of scans, one per turn of the lidar; 0 for none", unit="Hz", minimum=0.0)
    scan_beams: int = parameter(360, "number of beams in a full turn", minimum=1, maximum=16384)
    scan_view: float = parameter(
        2.0 * math.pi, "field of view, half of it to each side of straight ahead; a full turn starts straight ahead",
        unit="rad", above=0.0, maximum=2.0 * math.pi)
    scan_range_min: float = parameter(
        0.12, "shortest measured distance; nearer obstacles read 0", unit="m", minimum=0.0)
    scan_range_max: float = parameter(
        3.5, "longest measured distance; farther obstacles read +inf", unit="m", above=0.0)
    scan_resolution: float = parameter(
        0.015, "readings are rounded to multiples of this; 0 for no rounding", unit="m", minimum=0.0)
    scan_noise: float = parameter(0.01, "standard deviation of the readings", unit="m", minimum=0.0)
    scan_skew: bool = parameter(
        False, "measure each beam from where the robot is at that beam's time; false measures all at once")
    scan_dropout: float = parameter(0.0, "share of random beams that read +inf", minimum=0.0, maximum=1.0)

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the values for this set, by current names: the user's, else those of the robot's file."""
        own = super().known(values)
        settings = load_robot(str(own["robot"])).settings if "robot" in own else {}
        for name in cls.unknown_names(settings):
            raise ValueError(f"robot '{own['robot']}' sets '{name}', which the simulator has not")
        return {**super().known(settings), **own}

    def check(self) -> None:
        """Raise ValueError where a rate does not divide the physics rate or the lidar's ranges are out of order."""
        for name in RATES:
            self.steps_between(name)
        if self.scan_range_max <= self.scan_range_min:
            raise ValueError(
                f"parameter scan_range_max is {self.scan_range_max}; it must be above scan_range_min "
                f"({self.scan_range_min} m)"
            )

    @property
    def beam_directions(self) -> np.ndarray:
        """Directions of the lidar's beams, shape (B,) in radians, counter-clockwise from its x axis."""
        count = max(1, round(self.scan_beams * self.scan_view / (2.0 * math.pi)))
        increment = 2.0 * math.pi / self.scan_beams
        first = 0.0 if count == self.scan_beams else -0.5 * increment * (count - 1)
        return first + increment * np.arange(count)

    def steps_between(self, name: str) -> int:
        """Return the physics steps in one period of the rate of that name, 0 where the rate is 0."""
        return steps_between(name, getattr(self, name), self.physics_rate)


def steps_between(name: str, rate: float, physics_rate: int) -> int:
    """Return the number of physics steps in one period of `rate` (Hz), 0 for a rate of 0.

    Raises:
        ValueError: The rate does not divide the physics rate.
    """
    if rate == 0.0:
        return 0
    steps = round(physics_rate / rate)
    if steps < 1 or abs(steps * rate - physics_rate) > 1e-6 * physics_rate:
        nearest = [f"{physics_rate / steps:g}" for steps in (physics_rate // rate + 1, physics_rate // rate) if steps]
        raise ValueError(
            f"parameter {name} is {rate} Hz; it must divide physics_rate ({physics_rate} Hz), as "
            f"{' or '.join(nearest)} Hz {'do' if len(nearest) > 1 else 'does'}"
        )
    return int(steps)
