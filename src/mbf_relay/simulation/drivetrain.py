"""Drivetrains: they move the robot's body by velocity commands, with limits, delay, timeout and slip."""

from __future__ import annotations

import abc
import math
from collections import deque
from typing import Deque, Dict, Tuple, Type

import numpy as np

from mbf_relay.geometry import Twist2D, normalize_angle
from mbf_relay.simulation.base import Base
from mbf_relay.simulation.drive import approach, limit_command, wheel_speeds
from mbf_relay.simulation.four_wheels import mecanum_matrix
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import GRAVITY
from mbf_relay.simulation.robot import CAR, DIFFERENTIAL, OMNIDIRECTIONAL, RobotModel

PARK_AFTER = 0.5
"""Time (s) at rest after which the robot's body is put to sleep in the physics."""
MOST_LAG = 0.1
"""Largest angle (rad) by which a blocked wheel lags behind its target, lest it spin up when it comes free."""


State = Tuple[float, ...]
"""The motors' setpoints: wheel speeds (rad/s), a velocity, or a speed (m/s) and a steering angle (rad)."""


class Drivetrain(abc.ABC):
    """Moves a robot's body, one physics step at a time."""

    def __init__(self, base: Base, parameters: SimulationParameters, robot: RobotModel) -> None:
        """Begin at rest.

        Args:
            base: The robot's body in the physics.
            parameters: Parameters of motors and tyres.
            robot: The robot's geometry.
        """
        self._base, self._parameters, self._robot = base, parameters, robot
        self._period = 1.0 / parameters.physics_rate
        self._timeout = math.ceil(parameters.cmd_vel_timeout * parameters.physics_rate)
        self._park_steps = math.ceil(PARK_AFTER * parameters.physics_rate)
        self._waiting: Deque[Tuple[int, Twist2D]] = deque()
        self._step, self._command_step = 0, 0
        self._idle_steps = 0
        self._state = self._aim(Twist2D(0.0, 0.0, 0.0))
        self._target = self._state
        self._changes = self._most_change()

    def command(self, velocity: Twist2D, delay: float) -> None:
        """Take a velocity command that takes effect `delay` seconds from now."""
        due = self._step + round(delay * self._parameters.physics_rate)
        self._waiting.append((due, limit_command(velocity, self._parameters, self._robot.drive)))

    def halt(self) -> None:
        """Discard all commands and stop at once, after the robot was moved to another pose."""
        self._waiting.clear()
        self._target = self._state = self._aim(Twist2D(0.0, 0.0, 0.0))
        self._settle()
        self._wake()

    def advance(self, slip: float, restless: bool) -> None:
        """Apply commands and timeout, and set the motors for the next physics step.

        Args:
            slip: Share of the wheels' rotation that does not move the robot.
            restless: Whether something may push the robot, so that its body must not be put to sleep.
        """
        self._step += 1
        while self._waiting and self._waiting[0][0] < self._step:
            self._command_step = self._step
            self._target = self._aim(self._waiting.popleft()[1])
        if self._timeout and self._step - self._command_step > self._timeout:
            self._target = self._aim(Twist2D(0.0, 0.0, 0.0))
        if self._state == self._target and self._stands(self._state) and not restless:
            self._idle_steps += 1
            if self._idle_steps == self._park_steps:
                self._base.park()
        else:
            self._wake()
            if self._state != self._target:
                self._state = tuple(map(approach, self._state, self._target, self._changes))
        if self._idle_steps < self._park_steps:
            self._follow(slip)

    @abc.abstractmethod
    def wheel_angles(self) -> Tuple[float, ...]:
        """Return the angles (rad) of the driven wheels, slip included, in the order of the robot's joints."""

    @abc.abstractmethod
    def _aim(self, velocity: Twist2D) -> State:
        """Return the setpoints for a velocity of the robot."""

    @abc.abstractmethod
    def _most_change(self) -> State:
        """Return the largest change of each setpoint in one step."""

    @abc.abstractmethod
    def _follow(self, slip: float) -> None:
        """Apply the current setpoints to the body for one step."""

    @abc.abstractmethod
    def _settle(self) -> None:
        """Take over the body's pose and wheel angles after it was moved to another pose."""

    def _stands(self, state: State) -> bool:
        return not any(state)

    def _wake(self) -> None:
        if self._idle_steps >= self._park_steps:
            self._base.wake()
        self._idle_steps = 0


class TwoWheels(Drivetrain):
    """A differential drive: two motors turn wheels that have friction on the ground."""

    def __init__(self, base: Base, parameters: SimulationParameters, robot: RobotModel) -> None:
        super().__init__(base, parameters, robot)
        self._wanted = base.wheel_angles()
        self._spun = (0.0, 0.0)

    def wheel_angles(self) -> Tuple[float, ...]:
        left, right = self._base.wheel_angles()
        wanted_left, wanted_right = self._wanted
        self._wanted = (
            min(left + MOST_LAG, max(left - MOST_LAG, wanted_left)),
            min(right + MOST_LAG, max(right - MOST_LAG, wanted_right)),
        )
        return left + self._spun[0], right + self._spun[1]

    def _aim(self, velocity: Twist2D) -> State:
        return wheel_speeds(velocity, self._robot.wheels)

    def _most_change(self) -> State:
        return (self._parameters.wheel_acceleration * self._period / self._robot.wheels.radius,) * 2

    def _follow(self, slip: float) -> None:
        left, right = self._state
        if slip:
            spin = slip * self._period
            self._spun = (self._spun[0] + spin * left, self._spun[1] + spin * right)
            left, right = left * (1.0 - slip), right * (1.0 - slip)
        self._base.turn_wheels(*self._wanted, left, right)  # the servo compares with the angles before the step
        self._wanted = (self._wanted[0] + left * self._period, self._wanted[1] + right * self._period)

    def _settle(self) -> None:
        self._wanted = self._base.wheel_angles()


class FourWheels(Drivetrain):
    """Base class for four wheels: the body's velocity is controlled, within the tyres' grip.

    The wheels' angles are computed from the body's motion and slip.
    """

    def __init__(self, base: Base, parameters: SimulationParameters, robot: RobotModel) -> None:
        self._arm = math.hypot(robot.wheels.base, robot.wheels.separation) / 2.0
        super().__init__(base, parameters, robot)
        self._grip = parameters.wheel_friction * GRAVITY * self._period
        self._angles = np.zeros(len(robot.joints))
        self._pose = base.pose()

    def wheel_angles(self) -> Tuple[float, ...]:
        self._roll()
        return tuple(self._angles.tolist())

    def _follow(self, slip: float) -> None:
        self._roll()
        held = self._held()
        if slip:
            self._angles += slip * self._period * self._rotation(held)
            held = held.scaled(1.0 - slip)
        self._base.push(held, self._grip, self._grip / self._arm)

    def _settle(self) -> None:
        self._pose = self._base.pose()

    def _roll(self) -> None:
        """Advance the wheels' angles by the body's motion since the last call."""
        pose = self._base.pose()
        if pose == self._pose:
            return
        x, y = pose.x - self._pose.x, pose.y - self._pose.y
        turn = normalize_angle(pose.theta - self._pose.theta)
        middle = self._pose.theta + turn / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        self._angles += self._rotation(Twist2D(cos * x + sin * y, cos * y - sin * x, turn))
        self._pose = pose

    @abc.abstractmethod
    def _held(self) -> Twist2D:
        """Return the velocity for the current setpoints."""

    @abc.abstractmethod
    def _rotation(self, motion: Twist2D) -> np.ndarray:
        """Return the wheels' rotations (rad) for a displacement in the body's axes, or speeds (rad/s) for a velocity.
        """


class MecanumWheels(FourWheels):
    """An omnidirectional drive with four mecanum wheels."""

    def __init__(self, base: Base, parameters: SimulationParameters, robot: RobotModel) -> None:
        self._matrix = mecanum_matrix(robot.wheels)
        super().__init__(base, parameters, robot)

    def _aim(self, velocity: Twist2D) -> State:
        return tuple(velocity)

    def _most_change(self) -> State:
        rim = self._parameters.wheel_acceleration * self._period
        return rim, rim, rim / self._arm

    def _held(self) -> Twist2D:
        return Twist2D(*self._state)

    def _rotation(self, motion: Twist2D) -> np.ndarray:
        rotation: np.ndarray = self._matrix @ np.array(motion)
        return rotation


class SteeredWheels(FourWheels):
    """A car (Ackermann): the rear wheels are driven, the front ones steered, within the smallest turning radius."""

    _steering = 0.0
    """Steering angle (rad) of the last command, kept at standstill."""

    def _aim(self, velocity: Twist2D) -> State:
        wheels = self._robot.wheels
        if velocity.x == 0.0:
            return 0.0, self._steering
        most = math.atan(wheels.base / wheels.turning_radius)
        steering = math.atan(wheels.base * velocity.theta / velocity.x)
        self._steering = min(most, max(-most, steering))
        return velocity.x, self._steering

    def _most_change(self) -> State:
        return self._parameters.wheel_acceleration * self._period, self._robot.wheels.steering_rate * self._period

    def _stands(self, state: State) -> bool:
        return state[0] == 0.0

    def _held(self) -> Twist2D:
        speed, steering = self._state
        return Twist2D(speed, 0.0, speed * math.tan(steering) / self._robot.wheels.base)

    def _rotation(self, motion: Twist2D) -> np.ndarray:
        return np.array(wheel_speeds(motion, self._robot.wheels))


DRIVETRAINS: Dict[str, Type[Drivetrain]] = {
    DIFFERENTIAL: TwoWheels, OMNIDIRECTIONAL: MecanumWheels, CAR: SteeredWheels,
}
