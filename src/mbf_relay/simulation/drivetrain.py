"""From velocity commands to turning wheels: limits, delay, timeout, slip, and rest."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Tuple

from mbf_relay.geometry import Twist2D
from mbf_relay.simulation import burger
from mbf_relay.simulation.base import Base
from mbf_relay.simulation.drive import approach, limit_command, wheel_speeds
from mbf_relay.simulation.parameters import SimulationParameters

STANDSTILL = (0.0, 0.0)
PARK_AFTER = 0.5
"""Time (s) after which a standing robot's body sleeps."""
MOST_LAG = 0.1
"""Angle (rad) by which a wheel may lag behind before its motor lets go of the difference, as against a wall."""


class Drivetrain:
    """Drives the wheels of a base, one physics step at a time."""

    def __init__(self, base: Base, parameters: SimulationParameters) -> None:
        self._base, self._parameters = base, parameters
        self._period = 1.0 / parameters.physics_rate
        self._rim_change = parameters.wheel_acceleration * self._period / burger.WHEEL_RADIUS
        self._timeout = math.ceil(parameters.cmd_vel_timeout * parameters.physics_rate)
        self._park_steps = math.ceil(PARK_AFTER * parameters.physics_rate)
        self._waiting: Deque[Tuple[int, Twist2D]] = deque()
        self._step, self._command_step = 0, 0
        self._target = self._speeds = STANDSTILL
        self._wanted = base.wheel_angles()
        self._spun = STANDSTILL
        self._idle_steps = 0

    def command(self, velocity: Twist2D, delay: float) -> None:
        """Take a velocity command that takes effect `delay` seconds from now."""
        due = self._step + round(delay * self._parameters.physics_rate)
        self._waiting.append((due, limit_command(velocity, self._parameters)))

    def halt(self) -> None:
        """Forget all commands and stand, as after being set down."""
        self._waiting.clear()
        self._target = self._speeds = STANDSTILL
        self._wanted = self._base.wheel_angles()
        self._wake()

    def advance(self, slip: float, restless: bool) -> None:
        """Do what is due before the next physics step.

        Args:
            slip: Share of their rotation by which the wheels spin.
            restless: Something may push the robot, so that its body must not sleep.
        """
        self._step += 1
        while self._waiting and self._waiting[0][0] < self._step:
            self._command_step = self._step
            self._target = wheel_speeds(self._waiting.popleft()[1])
        if self._timeout and self._step - self._command_step > self._timeout:
            self._target = STANDSTILL
        if self._speeds == self._target == STANDSTILL and not restless:
            self._idle_steps += 1
            if self._idle_steps == self._park_steps:
                self._base.park()
        else:
            self._wake()
            if self._speeds != self._target:
                (left, right), (left_target, right_target) = self._speeds, self._target
                self._speeds = (
                    approach(left, left_target, self._rim_change), approach(right, right_target, self._rim_change)
                )
        if self._idle_steps < self._park_steps:
            self._turn_wheels(slip)

    def wheel_angles(self) -> Tuple[float, float]:
        """Return how far (rad) the wheels have turned, left and right, spinning included."""
        left, right = self._base.wheel_angles()
        wanted_left, wanted_right = self._wanted
        self._wanted = (
            min(left + MOST_LAG, max(left - MOST_LAG, wanted_left)),
            min(right + MOST_LAG, max(right - MOST_LAG, wanted_right)),
        )
        return left + self._spun[0], right + self._spun[1]

    def _turn_wheels(self, slip: float) -> None:
        left, right = self._speeds
        if slip:
            spin = slip * self._period
            self._spun = (self._spun[0] + spin * left, self._spun[1] + spin * right)
            left, right = left * (1.0 - slip), right * (1.0 - slip)
        self._wanted = (self._wanted[0] + left * self._period, self._wanted[1] + right * self._period)
        self._base.turn_wheels(*self._wanted, left, right)

    def _wake(self) -> None:
        if self._idle_steps >= self._park_steps:
            self._base.wake()
        self._idle_steps = 0
