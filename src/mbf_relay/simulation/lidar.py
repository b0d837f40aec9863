"""The lidar: all beams of a turn in one call, with the errors a real one makes."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.scan import LaserScan
from mbf_relay.simulation import burger
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import Physics


class Lidar:
    """A planar lidar with beams all round, the first along its x axis, counter-clockwise.

    All beams are taken at one instant, which is the stamp. Rays start at the sensor and never see the robot itself.
    """

    def __init__(self, physics: Physics, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self._physics, self._parameters, self._rng = physics, parameters, rng
        self._increment = 2.0 * math.pi / parameters.scan_beams
        angles = self._increment * np.arange(parameters.scan_beams)
        self._reach = parameters.scan_range_max * np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))

    def scan(self, base: Frame, stamp: float) -> LaserScan:
        """Return a scan taken at `stamp` (s) with base_link at `base` in the world."""
        parameters = self._parameters
        return LaserScan(
            self._with_errors(self._distances(base)), 0.0, self._increment, parameters.scan_range_min,
            parameters.scan_range_max, stamp, burger.SCAN_FRAME,
        )

    def _distances(self, base: Frame) -> np.ndarray:
        """Return the true distances, shape (B,) in metres, +inf where there is nothing within range."""
        sensor = base.compose(burger.SCAN_IN_BASE)
        starts = np.broadcast_to(sensor.position, self._reach.shape).copy()
        shares = self._physics.cast(starts, sensor.transform_points(self._reach))
        return np.where(shares < 1.0, shares * self._parameters.scan_range_max, np.inf)

    def _with_errors(self, distances: np.ndarray) -> np.ndarray:
        """Return readings: noise, steps, limits and dropouts added to true distances, shape (B,) in metres."""
        parameters = self._parameters
        if parameters.scan_noise > 0.0:
            distances = distances + parameters.scan_noise * self._rng.standard_normal(len(distances))
        if parameters.scan_resolution > 0.0:
            distances = np.round(distances / parameters.scan_resolution) * parameters.scan_resolution
        distances = np.where(distances > parameters.scan_range_max, np.inf, distances)
        distances = np.where(distances < parameters.scan_range_min, 0.0, distances)
        if parameters.scan_dropout > 0.0:
            distances[self._rng.random(len(distances)) < parameters.scan_dropout] = np.inf
        return distances
